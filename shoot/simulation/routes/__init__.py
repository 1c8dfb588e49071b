"""Many routes: which, what of one is scored, and all of them summed up."""
