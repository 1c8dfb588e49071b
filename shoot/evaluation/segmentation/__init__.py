"""A segmentation on a split: from maps of probabilities to a report, and one report to another."""
