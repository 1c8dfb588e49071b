"""Cameras and lidar that look at it by casting rays."""
