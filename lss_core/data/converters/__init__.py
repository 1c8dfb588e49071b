"""Data sets of others in, recordings of one kind out, which become nuScenes tables."""
