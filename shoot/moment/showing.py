"""A plan for people: the table of a terminal, and the picture."""

import numpy as np
from matplotlib.figure import Figure

from lss_core.legible import legible
from shoot.metrics.manoeuvres import classify_manoeuvres
from shoot.moment.planning import Moment, MomentPlan
from shoot.prediction.plain import PlainRun
from shoot.rendering.sample_figure import render_sample
from shoot.rendering.sample_view import SampleView
from shoot.report.cells import as_text, new_table
from shoot.report.shown_sample import whole_images


def format_plan(run: PlainRun, plan: MomentPlan, num: int, width: int = 80) -> str:
    """The most probable templates as text for a terminal.

    Args:
        run: Who planned.
        plan: What it said.
        num: How many templates.
        width: Columns of the terminal.
    """
    templates = run.templates
    best = plan.order[:num]
    kinds = classify_manoeuvres(templates.points[best])
    way_m = np.linalg.norm(np.diff(templates.points[best], axis=1, prepend=0.0), axis=-1).sum(-1)
    horizon_s = templates.horizon_s
    table = new_table(f"The {len(best)} most probable of {len(templates.points)} templates")
    table.add_column("rank", justify="right")
    table.add_column("probability, %", justify="right")
    table.add_column("manoeuvre")
    table.add_column("mean speed, m/s", justify="right")
    table.add_column(f"at {horizon_s:g} s: x, y in m", justify="right")
    for rank, (k, kind, length_m) in enumerate(zip(best, kinds, way_m, strict=True), start=1):
        x_m, y_m = templates.points[k, -1]
        table.add_row(
            str(rank),
            f"{100.0 * plan.probabilities[k]:.1f}",
            str(kind),
            f"{length_m / horizon_s:.1f}",
            f"{x_m:.1f}, {y_m:+.1f}",
        )
    return as_text([table], width)


def draw_plan(
    run: PlainRun, moment: Moment, plan: MomentPlan, title: str, caption: str = ""
) -> Figure:
    """The picture of a plan: images, cost map, ranked templates.

    Args:
        run: Who planned.
        moment: From what.
        plan: What it said.
        title: Headline.
        caption: Small print below it.

    Raises:
        DataError: If an image cannot be read.
    """
    images, intrinsics = whole_images(
        moment.paths,
        [camera.image_hw for camera in moment.cameras],
        np.stack([camera.rawpixel_from_camera for camera in moment.cameras]),
    )
    view = SampleView(
        images=images,
        pixel_from_camera=intrinsics,
        ego_from_camera=moment.ego_from_camera,
        camera_names=tuple(legible(camera.name) for camera in moment.cameras),
        grid=run.config.model.grid,
        cost_map=plan.cost_map,
        templates=run.templates.points,
        probabilities=plan.probabilities,
        dt_s=run.templates.dt_s,
        title=title,
        caption=caption,
    )
    return render_sample(view)
