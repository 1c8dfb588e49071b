"""A drive as pictures: frames of a video, and the few that tell it on a page."""
