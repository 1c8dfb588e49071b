"""A report and pictures in, one HTML page that needs nothing else out."""

from shoot.report.html.cards import SampleCard, figure_png
from shoot.report.html.page import PageDetails, render_page, write_page
from shoot.report.html.picking import pick_samples

__all__ = ["PageDetails", "SampleCard", "figure_png", "pick_samples", "render_page", "write_page"]
