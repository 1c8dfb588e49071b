"""What people annotated, for evaluation: boxes and where cars may drive."""
