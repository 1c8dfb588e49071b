"""The runs of docs/results.md and their tables."""
