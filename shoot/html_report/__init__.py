"""A report and pictures in, one HTML page that needs nothing else out."""

from shoot.html_report.cards import SampleCard, figure_png
from shoot.html_report.page import PageDetails, render_page, write_page
from shoot.html_report.picking import pick_samples

__all__ = ["PageDetails", "SampleCard", "figure_png", "pick_samples", "render_page", "write_page"]
