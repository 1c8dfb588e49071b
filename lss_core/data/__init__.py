"""Disk to Batch: nuScenes tables, images and what is cached of them."""
