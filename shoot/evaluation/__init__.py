"""A planner beside its baselines on a split: from log-probabilities to a report."""
