"""What is in a data set, and what of it contradicts itself."""

from shoot.data_report.facts import DataReport, Finding
from shoot.data_report.pictures import view_cameras
from shoot.data_report.survey import survey
from shoot.data_report.table import format_report

__all__ = ["DataReport", "Finding", "format_report", "survey", "view_cameras"]
