"""The card: what must be known beside an exported planner to feed it and to read what it says."""

import json
from pathlib import Path
from typing import Any

import torch

from lss_core.camera import cell_centres
from lss_core.files import write_atomically
from lss_core.model import CameraModel
from shoot.export.graph import PlannerGraph
from shoot.prediction.run import TrainedRun

FORMAT_VERSION = 1
_FRAME = "ego: x forward, y left, z up; origin on the ground under the rear axle's middle; metres"


def make_card(run: TrainedRun, graph: PlannerGraph) -> dict[str, Any]:
    """The constants of a run that `numpy_inputs` needs, and what its templates are.

    Args:
        run: What is exported.
        graph: Made of its module.
    """
    config, image, grid = run.config.model, run.config.data.image, graph.grid
    rows_px, columns_px = _feature_centres(graph.model)
    depths_m = list(config.depth.depths_m)
    window = graph.window
    return {
        "format_version": FORMAT_VERSION,
        "frame": _FRAME,
        "images": {
            "height_px": image.height_px,
            "width_px": image.width_px,
            "channels": "RGB, uint8, 0 to 255",
            "crop_bottom": sum(image.crop_bottom) / 2,
            "horizon": list(image.horizon),
        },
        "cameras_trained_on": list(run.config.data.cameras),
        "features": {
            "rows_px": rows_px,
            "columns_px": columns_px,
            "depths_m": depths_m,
            "stride_px": config.image_stride,
        },
        "points_a_camera": len(rows_px) * len(columns_px) * len(depths_m),
        "grid": {
            "x_min_m": grid.x_min_m,
            "y_min_m": grid.y_min_m,
            "cell_m": grid.cell_m,
            "num_x": grid.num_x,
            "num_y": grid.num_y,
            "z_min_m": config.z_min_m,
            "z_max_m": config.z_max_m,
        },
        "cost_map": {
            "x_min_m": grid.x_min_m + window.x_start * grid.cell_m,
            "y_min_m": grid.y_min_m + window.y_start * grid.cell_m,
            "num_x": window.shape[0],
            "num_y": window.shape[1],
            "num_maps": graph.planner.num_maps,
        },
        "templates": {
            "sha256": run.templates.sha256,
            "num_templates": len(run.templates.points),
            "num_points": run.templates.points.shape[1],
            "dt_s": run.templates.dt_s,
        },
    }


def _feature_centres(model: CameraModel) -> tuple[list[float], list[float]]:
    """Row and column of the pixels that feature cells stand for."""
    stride, device = model.config.image_stride, torch.device("cpu")
    centers = model.centers
    first_u, first_v = (centers, centers) if isinstance(centers, str) else centers.cpu()
    height_px, width_px = model.image_hw
    return (
        cell_centres(height_px, stride, first_v, device).tolist(),
        cell_centres(width_px, stride, first_u, device).tolist(),
    )


def write_card(card: dict[str, Any], path: Path) -> None:
    """Write it as JSON, whole or not at all.

    Raises:
        OSError: If it cannot be written.
    """
    with write_atomically(path) as stream:
        stream.write((json.dumps(card, indent=2) + "\n").encode())
