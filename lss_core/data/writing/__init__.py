"""Recordings in, tables and files out."""
