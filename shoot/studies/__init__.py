"""Questions about what a planner has learned, each asked once."""
