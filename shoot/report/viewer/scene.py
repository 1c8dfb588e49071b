"""All that a page shows of a scene, as plain values: what was seen, planned and driven, in time."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray

from lss_core.data.dataset import ego_from_camera
from lss_core.data.sensors.lidar import load_sweep
from lss_core.geometry import FloatArray, invert, yaw_of
from lss_core.legible import legible
from lss_core.progress import progress
from shoot.footprint import footprint_corners
from shoot.metrics.ranks import rank_labels, top_templates
from shoot.prediction.run import TrainedRun, batches, check_scores
from shoot.rendering.bev_panel import cost_range
from shoot.rendering.layout import camera_label, camera_places
from shoot.report.sample_views import of_times
from shoot.report.shown_sample import shown_images
from shoot.report.viewer.pictures import cost_picture, image_within, points_picture
from shoot.report.viewer.surroundings import boxes_around, road_edges
from shoot.training.planning.data import LabelledSplit

NUM_BEST = 10
# Of a page, some to spare for markup and script. MB are of 10^6 bytes.
MOST_BYTES = 19_500_000
# A longer scene is shown in larger steps, so that each image keeps some kilobytes.
MOST_SAMPLES = 240

Points = list[list[float]]


@dataclass(frozen=True)
class CameraPlace:
    """Where a camera's image stands; rows and columns count from 1."""

    label: str
    row: int
    column: int


@dataclass(frozen=True)
class SeenImage:
    """What a camera saw.

    Attributes:
        camera: Its place in the scene's list of cameras.
        picture: As a text that a page can show.
        image_from_ground: [3, 3] takes (x, y, 1) on the ground, in metres in `ego`, to (u, v, 1)
            times depth; u and v are 0 at the image's left and upper border, 1 at the others.
    """

    camera: int
    picture: str
    image_from_ground: Points


@dataclass(frozen=True)
class ViewedSample:
    """One moment; points are (x, y) in its `ego`, in metres.

    Attributes:
        token: Of the sample.
        time_s: Since the first one shown.
        pose: x, y and heading in the frame of the first one shown.
        images: One for each camera that has one.
        cost: Cost map from above, forward up.
        points: Lidar points likewise; empty without.
        boxes: Corners of vehicles and people.
        driven: The path, at the times of the templates.
        best: Numbers of the most probable templates, best first.
        probabilities: Theirs.
        label: Number of the template nearest to the driven path.
        label_probability: Its probability.
        rank: Its rank; 1 is best, and for equally probable ones the best of theirs.
        hit: Whether it is among the ten best; between 0 and 1 where equally probable ones are
            parted.
    """

    token: str
    time_s: float
    pose: list[float]
    images: list[SeenImage]
    cost: str
    points: str
    boxes: list[Points]
    driven: Points
    best: list[int]
    probabilities: list[float]
    label: int
    label_probability: float
    rank: int
    hit: float


@dataclass(frozen=True)
class ViewedScene:
    """A scene in time.

    Attributes:
        name: Its name.
        description: In words.
        about: What else there is to know, in sentences.
        cameras: Whose images are shown.
        grid: x_min, x_max, y_min, y_max of the cost map, in metres.
        cost_range: Costs that are white and dark.
        ego: Corners of the car.
        road: Edges of the road, in the frame of the first sample.
        dt_s: Time between points of a path.
        num_templates: Of the run.
        templates: Those that are shown, by their numbers.
        samples: In the order of time.
    """

    name: str
    description: str
    about: list[str]
    cameras: list[CameraPlace]
    grid: list[float]
    cost_range: list[float]
    ego: Points
    road: list[Points]
    dt_s: float
    num_templates: int
    templates: dict[str, Points]
    samples: list[ViewedSample]


def view_scene(run: TrainedRun, split: LabelledSplit, about: list[str]) -> ViewedScene:
    """What the planner saw and thought in a scene, and what the driver did.

    Args:
        run: Trained planner.
        split: Samples of one scene, in the order of time.
        about: Sentences for the page, before its own.

    Raises:
        DataError: If a file is missing or damaged, or scores are not finite.
    """
    index, grid = split.index, run.config.model.grid
    log_prob, cost_maps = _predict(run, split)
    low, high = cost_range(cost_maps.reshape(-1, cost_maps.shape[-1]))
    first = index.global_from_ego[split.rows[0]]
    reach_m = float(np.abs([grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m]).max())
    road = [
        _rounded(line @ first[:2, :2] - first[:2, 3] @ first[:2, :2])
        for line in road_edges(run.config.data, split, 1.5 * reach_m)
    ]
    costs = [cost_picture(cost_map, low, high) for cost_map in cost_maps]
    samples = _samples(run, split, log_prob, costs, MOST_BYTES - len(str(road)))
    shown = sorted({number for s in samples for number in (*s.best, s.label)})
    scene = int(split.scene_rows[0])
    return ViewedScene(
        name=legible(str(index.scene_name[scene])),
        description=legible(str(index.scene_description[scene])),
        about=[*about, *_sentences(run, split)],
        cameras=_places(run, split),
        grid=[grid.x_min_m, grid.x_max_m, grid.y_min_m, grid.y_max_m],
        cost_range=[float(f"{low:.2g}"), float(f"{high:.2g}")],
        ego=_rounded(footprint_corners(np.zeros(2), np.zeros(()))),
        road=road,
        dt_s=run.templates.dt_s,
        num_templates=len(run.templates.points),
        templates={str(number): _rounded(run.templates.points[number]) for number in shown},
        samples=samples,
    )


@torch.no_grad()
def _predict(
    run: TrainedRun, split: LabelledSplit
) -> tuple[NDArray[np.float32], Float[np.ndarray[Any, np.dtype[np.float32]], "S X Y"]]:
    """Log-probabilities [S, K], and the maps they come from."""
    log_prob, cost_maps = [], []
    with progress("Predicting samples", len(split)) as advance:
        for batch in batches(run, split, np.arange(len(split))):
            maps = run.module.cost_maps(batch.sensors)
            scores = run.module.outputs(maps)
            log_prob.append(scores.log_softmax(dim=-1).float().cpu().numpy())
            cost_maps.append(maps.mean(dim=1).float().cpu().numpy())
            advance(len(maps))
    return check_scores(np.concatenate(log_prob)), np.concatenate(cost_maps)


def _samples(
    run: TrainedRun,
    split: LabelledSplit,
    log_prob: NDArray[np.float32],
    costs: list[str],
    most_bytes: int,
) -> list[ViewedSample]:
    """All moments; images have what the rest leaves of so many bytes."""
    index, data = split.index, run.config.data
    best = top_templates(log_prob, NUM_BEST)
    ranks = rank_labels(log_prob, split.labels)
    hits = ranks.hits(NUM_BEST)
    boxes = [[_rounded(box) for box in around] for around in boxes_around(data, split)]
    points = [_points(run, split, int(row)) for row in split.rows]
    prob = np.exp(log_prob.astype(np.float64))
    global_from_ego = index.global_from_ego[split.rows]
    first_from_ego = invert(global_from_ego[0]) @ global_from_ego
    pose = np.column_stack([first_from_ego[:, :2, 3], yaw_of(first_from_ego)])
    num_images = 0 if data.lidar_scans else int(index.has_camera[split.rows].sum())
    rest = sum(map(len, costs)) + sum(map(len, points)) + len(str(boxes)) + 2000 * len(split)
    budget = max(0, most_bytes - rest) // max(1, num_images)
    samples = []
    with progress("Gathering images", len(split)) as advance:
        for position, row in enumerate(split.rows.tolist()):
            label = int(split.labels[position])
            samples.append(
                ViewedSample(
                    token=legible(str(index.sample_token[row])),
                    time_s=round(float(index.time_s[row] - index.time_s[split.rows[0]]), 3),
                    pose=[round(float(value), 4) for value in pose[position]],
                    images=_images(run, split, row, budget) if num_images else [],
                    cost=costs[position],
                    points=points[position],
                    boxes=boxes[position],
                    driven=_rounded(split.futures.xy_m[position]),
                    best=best[position].tolist(),
                    probabilities=[_short(value) for value in prob[position, best[position]]],
                    label=label,
                    label_probability=_short(prob[position, label]),
                    rank=int(ranks.num_before[position]) + 1,
                    hit=round(float(hits[position]), 3),
                )
            )
            advance(1)
    return samples


def _images(run: TrainedRun, split: LabelledSplit, row: int, budget: int) -> list[SeenImage]:
    """Of the cameras that have one, with where the ground is in them."""
    data = run.config.data
    images, intrinsics, _, there = shown_images(split.index, Path(data.root), row)
    height_px, width_px = images.shape[1:3]
    # A pixel's middle is a whole number, so the left border is at -0.5.
    share_from_pixel = np.array(
        [[1 / width_px, 0, 0.5 / width_px], [0, 1 / height_px, 0.5 / height_px], [0, 0, 1]]
    )
    camera_from_ego = invert(ego_from_camera(split.index, row, data.ego_motion)[there])
    image_from_ground = share_from_pixel @ intrinsics @ camera_from_ego[:, :3][..., [0, 1, 3]]
    return [
        SeenImage(camera, image_within(image, budget), _rounded(matrix, 7))
        for camera, image, matrix in zip(there, images, image_from_ground, strict=True)
    ]


def _points(run: TrainedRun, split: LabelledSplit, row: int) -> str:
    """The sweep of a planner that sees sweeps."""
    if not run.config.data.lidar_scans:
        return ""
    sweep_m = load_sweep(split.index, Path(run.config.data.root), row)
    return points_picture(sweep_m, run.config.model.grid)


def _places(run: TrainedRun, split: LabelledSplit) -> list[CameraPlace]:
    """Of all cameras; none of a planner that sees no images."""
    if run.config.data.lidar_scans:
        return []
    names = tuple(legible(str(name)) for name in split.index.cameras)
    places, _, _ = camera_places(names)
    return [
        CameraPlace(camera_label(name), row + 1, column + 1)
        for name, (row, column) in zip(names, places, strict=True)
    ]


def _sentences(run: TrainedRun, split: LabelledSplit) -> list[str]:
    """What of the scene and of the map is not shown."""
    sentences = []
    if split.num_left_out:
        sentences.append(
            f"{split.num_left_out} samples are not shown: they have no whole future of "
            f"{run.templates.horizon_s:g} s, or cannot be used."
        )
    if of_times(run):
        sentences.append(f"{of_times(run)[2:].capitalize()}.")
    return sentences


def _rounded(points: FloatArray | NDArray[np.floating[Any]], decimals: int = 2) -> Points:
    rounded: Points = np.round(points.astype(np.float64), decimals).tolist()
    return rounded


def _short(probability: float) -> float:
    """To six digits, which is what single precision holds."""
    return float(f"{probability:.6g}")
