"""Does a planner of the synthetic city know where the ego will turn? Ask, score, draw."""
