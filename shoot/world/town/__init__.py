"""What stands still: a town from a seed."""
