"""Drives, records and tables of scripts/closed_loop.py."""
