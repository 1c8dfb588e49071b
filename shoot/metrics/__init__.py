"""What is measured of a planner: pure functions of arrays."""
