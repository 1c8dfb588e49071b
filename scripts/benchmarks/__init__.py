"""The rows of scripts/benchmark.py, one module each, and how they are measured."""
