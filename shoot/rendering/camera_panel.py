"""One camera image with paths on the ground, and lidar points, drawn where the camera sees them."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from lss_core.camera import project
from shoot.footprint import EGO_WIDTH_M
from shoot.rendering import palette
from shoot.rendering.image_panel import NEAR_M, draw_image, where_seen
from shoot.rendering.line_style import driven_style
from shoot.rendering.sample_view import FloatArray, Ranking, SampleView, from_origin

STEP_M = 0.1
LIDAR_DEPTH_M = (3.0, 60.0)


def subdivide(path_m: Float[FloatArray, "T D"], step_m: float) -> Float[FloatArray, "S D"]:
    """The same polyline with points at most `step_m` apart; points that repeat are left out.

    A straight line on the ground is straight in the image too, but only what is in front of the
    camera may be drawn, and short steps let it end where it leaves the view.
    """
    lengths_m = np.linalg.norm(np.diff(path_m, axis=0), axis=-1)
    along_m = np.concatenate([[0.0], np.cumsum(lengths_m)])
    if along_m[-1] < 1e-6:
        return path_m[:1]
    fine_m = np.linspace(0.0, along_m[-1], int(np.ceil(along_m[-1] / step_m)) + 1)
    fine_m = np.unique(np.concatenate([fine_m, along_m]))
    fine: FloatArray = np.stack(
        [np.interp(fine_m, along_m, column) for column in path_m.T], axis=-1
    )
    return fine


def _runs(kept: NDArray[np.bool_]) -> list[slice]:
    """Stretches of True, two points or longer."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(np.int8)))
    return [
        slice(int(start), int(stop))
        for start, stop in zip(edges[::2], edges[1::2], strict=True)
        if stop - start >= 2
    ]


def project_path(
    path_m: Float[FloatArray, "T 2"],
    pixel_from_camera: Float[FloatArray, "3 3"],
    ego_from_camera: Float[FloatArray, "4 4"],
    image_hw: tuple[int, int],
    step_m: float = STEP_M,
    near_m: float = NEAR_M,
) -> list[Float[FloatArray, "_ 2"]]:
    """Polylines in pixels: the parts of a path that the camera sees.

    The path lies on the ground, z = 0 in `ego`. Each part reaches one short step beyond the
    image's border, so that it ends at the border once the panel clips it; nothing behind the
    camera or nearer than `near_m` in front of it is kept.
    """
    fine = subdivide(path_m, step_m)
    ground = np.concatenate([fine, np.zeros((len(fine), 1))], axis=-1)
    pixels, depth_m = project(ground, pixel_from_camera, ego_from_camera)
    inside = where_seen(pixels, depth_m, image_hw, near_m)
    beside = inside.copy()
    beside[1:] |= inside[:-1]
    beside[:-1] |= inside[1:]
    return [pixels[run] for run in _runs(beside & (depth_m >= near_m))]


def project_ribbon(
    path_m: Float[FloatArray, "T 2"],
    width_m: float,
    pixel_from_camera: Float[FloatArray, "3 3"],
    ego_from_camera: Float[FloatArray, "4 4"],
    image_hw: tuple[int, int],
    step_m: float = STEP_M,
    near_m: float = NEAR_M,
) -> list[Float[FloatArray, "_ 2"]]:
    """Outlines in pixels of a carpet `width_m` wide along a path on the ground, where it is seen.

    Empty for a path that goes nowhere: it has no direction to lay a carpet along.
    """
    fine = subdivide(path_m, step_m)
    if len(fine) < 2:
        return []
    heading = np.gradient(fine, axis=0)
    heading /= np.maximum(np.linalg.norm(heading, axis=-1, keepdims=True), 1e-9)
    left = np.stack([-heading[:, 1], heading[:, 0]], axis=-1)
    sides_m = np.stack([fine + 0.5 * width_m * left, fine - 0.5 * width_m * left])
    ground = np.concatenate([sides_m, np.zeros((*sides_m.shape[:2], 1))], axis=-1)
    pixels, depth_m = project(ground, pixel_from_camera, ego_from_camera)
    inside = where_seen(pixels, depth_m, image_hw, near_m).any(axis=0)
    beside = inside.copy()
    beside[1:] |= inside[:-1]
    beside[:-1] |= inside[1:]
    runs = _runs(beside & (depth_m >= near_m).all(axis=0))
    return [np.concatenate([pixels[0, run], pixels[1, run][::-1]]) for run in runs]


def draw_camera(
    axes: Axes, view: SampleView, camera_idx: int, ranking: Ranking | None, label: str
) -> None:
    """Fill one panel: the image, lidar points by depth, planned paths, the driven path, a name."""
    image = view.images[camera_idx]
    image_hw = (int(image.shape[0]), int(image.shape[1]))
    camera = (view.pixel_from_camera[camera_idx], view.ego_from_camera[camera_idx])
    draw_image(axes, image, label)
    if view.lidar_points_ego is not None:
        pixels, depth_m = project(view.lidar_points_ego, *camera)
        seen = where_seen(pixels, depth_m, image_hw, NEAR_M)
        axes.scatter(
            pixels[seen, 0],
            pixels[seen, 1],
            c=np.log(np.clip(depth_m[seen], *LIDAR_DEPTH_M)),
            cmap=palette.DEPTH,
            vmin=np.log(LIDAR_DEPTH_M[0]),
            vmax=np.log(LIDAR_DEPTH_M[1]),
            s=2.2,
            linewidths=0,
            zorder=1,
            gid="lidar",
        )
    if ranking is not None:
        for place in reversed(range(len(ranking.paths_m))):
            _draw_planned(axes, ranking, place, camera, image_hw)
    if view.driven is not None:
        for pixels in project_path(from_origin(view.driven), *camera, image_hw):
            axes.plot(*pixels.T, gid="driven", zorder=5, **driven_style(2.4))


def _draw_planned(
    axes: Axes,
    ranking: Ranking,
    place: int,
    camera: tuple[FloatArray, FloatArray],
    image_hw: tuple[int, int],
) -> None:
    """One planned path: colour and width say how probable it is; the best has a carpet."""
    strength = float(ranking.strengths[place])
    colour = palette.PROBABILITY(strength)
    path_m = ranking.paths_m[place]
    if place == 0:
        for outline in project_ribbon(path_m, EGO_WIDTH_M, *camera, image_hw):
            axes.add_patch(
                Polygon(
                    outline,
                    closed=True,
                    facecolor=(*palette.PROBABILITY(0.35)[:3], 0.33),
                    edgecolor=(*palette.PROBABILITY(0.5)[:3], 0.9),
                    linewidth=0.8,
                    zorder=2,
                    gid="carpet",
                )
            )
    for pixels in project_path(path_m, *camera, image_hw):
        axes.plot(
            *pixels.T,
            color=colour,
            linewidth=1.0 + 1.8 * strength,
            solid_capstyle="round",
            path_effects=[Stroke(linewidth=2.2 + 1.8 * strength, foreground="#ffffffb0"), Normal()],
            zorder=3 + 0.9 * strength,
            gid="planned",
        )
    end, depth_m = project(np.array([[*path_m[-1], 0.0]]), *camera)
    if where_seen(end, depth_m, image_hw, NEAR_M)[0]:
        axes.plot(
            *end.T,
            marker="o",
            markersize=3.0 + 1.5 * strength,
            color=colour,
            markeredgecolor=palette.PAPER,
            markeredgewidth=0.6,
            zorder=3 + 0.9 * strength,
            gid="planned-end",
        )
