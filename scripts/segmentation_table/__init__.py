"""Runs and tables of scripts/segmentation_tables.py."""
