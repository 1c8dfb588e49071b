"""Pictures of what the planner sees and decides: arrays in, matplotlib figure out."""

from shoot.rendering.calibration_figure import CalibrationView, render_calibration
from shoot.rendering.sample_figure import render_sample
from shoot.rendering.sample_view import SampleView
from shoot.rendering.saving import save_figure
from shoot.rendering.segmentation_figure import render_segmentation
from shoot.rendering.segmentation_view import SegmentationView
from shoot.rendering.template_figure import render_templates

__all__ = [
    "CalibrationView",
    "SampleView",
    "SegmentationView",
    "render_calibration",
    "render_sample",
    "render_segmentation",
    "render_templates",
    "save_figure",
]
