"""The paper's baselines (section 5.1): other roads from images to map, the same two networks."""
