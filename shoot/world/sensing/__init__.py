"""Cameras and lidar that look at the city by casting rays."""
