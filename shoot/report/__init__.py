"""A report for people: in a terminal, as a page, with pictures of samples."""
