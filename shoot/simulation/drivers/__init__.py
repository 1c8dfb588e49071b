"""What plans in the loop: a trained planner, and what it stands beside."""
