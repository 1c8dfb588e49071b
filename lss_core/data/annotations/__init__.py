"""What people annotated, for labels and evaluation: boxes, where cars may drive, dividers."""
