"""Who drives and walks through a town, and why: from a town to recordings."""
