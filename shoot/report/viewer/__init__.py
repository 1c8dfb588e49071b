"""A scene of a trained planner as one page to scrub through, with a script of its own."""
