"""What in recordings contradicts itself: poses, headings, calibration, times."""
