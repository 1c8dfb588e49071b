"""Colours, chosen to survive colour blindness and grey print.

Things of different kinds differ in hue (two far ends of the Okabe-Ito palette) and in line style;
a quantity is a ramp whose lightness only rises or only falls.
"""

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap

INK = "#1b1f24"
SOFT_INK = "#6a737d"
PAPER = "#ffffff"
PLANNED = "#d55e00"  # Okabe-Ito vermillion, solid lines
DRIVEN = "#0072b2"  # Okabe-Ito blue, dashed lines
EGO = "#1b1f24"

# Probability: pale orange (unlikely) to dark vermillion (likely).
PROBABILITY: Colormap = LinearSegmentedColormap.from_list(
    "probability", ["#f5b97a", "#ea8230", PLANNED, "#963a00"]
)
# Cost: white where it is cheap to drive, slate where it is dear. A ramp without hue leaves hue
# to the trajectories drawn on top of it.
COST: Colormap = LinearSegmentedColormap.from_list(
    "cost", ["#ffffff", "#d3d9df", "#a4aeb9", "#78838f", "#505b67"]
)
DEPTH: Colormap = mpl.colormaps["plasma"]
COUNT: Colormap = LinearSegmentedColormap.from_list(
    "count", mpl.colormaps["cividis_r"](np.linspace(0.12, 1.0, 64))
)
# Classes of a segmentation, as in the paper's figure 1: vehicles blue, road orange, lanes green.
CLASSES = {
    "drivable": "#e69f00",
    "lane_boundary": "#009e73",
    "vehicle": "#cc79a7",
    "car": "#0072b2",
}
OFF_MAP = "#f3ecdf"  # ground the map does not cover
