"""One moment from any calibrated rig: its file, its images, what is planned and how it looks."""
