"""Runs, conditions and tables of scripts/robustness.py."""
