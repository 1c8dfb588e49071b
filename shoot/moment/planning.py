"""A moment's images in, ranked templates out, and what is written of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lss_core.batch import Batch, collate
from lss_core.data.sensors.images import load_image
from lss_core.data.sensors.views import View, read_views
from lss_core.errors import DataError
from lss_core.geometry import FloatArray
from shoot.moment.rig_file import Rig, RigCamera
from shoot.prediction.plain import PlainRun
from shoot.training.planning.focal_lengths import FocalLengths, network_focal_px

FRAME = (
    "ego: x forward, y left, z up, in metres; the origin lies on the ground below the middle of "
    "the rear axle"
)


# Lenses beyond those of training by more than this are told of.
_STRANGE_FACTOR = 1.3


@dataclass(frozen=True)
class Moment:
    """What cameras of a rig see at one time.

    Attributes:
        cameras: One or more of the rig, in its order.
        paths: Their images' files.
        speed_mps: How fast the car drives, straight ahead.
    """

    cameras: tuple[RigCamera, ...]
    paths: tuple[Path, ...]
    speed_mps: float = 0.0

    @property
    def ego_from_camera(self) -> FloatArray:
        """[N, 4, 4] where each camera was when it fired, in `ego` at the moment."""
        poses = np.stack([camera.ego_from_camera for camera in self.cameras])
        poses[:, 0, 3] += [self.speed_mps * camera.delay_s for camera in self.cameras]
        return poses

    @staticmethod
    def of(rig: Rig, paths: Mapping[str, Path], speed_mps: float = 0.0) -> "Moment":
        """The moment of some of a rig's cameras, by name.

        Raises:
            DataError: If a name is none of the rig's, or there is none.
        """
        names = [camera.name for camera in rig.cameras]
        unknown = [name for name in paths if name not in names]
        if unknown:
            raise DataError(
                f"There is an image of '{unknown[0]}', which is no camera of the rig; its cameras "
                f"are {', '.join(names)}."
            )
        if not paths:
            raise DataError(f"There is no image; give one or more, as {names[0]}=image.jpg.")
        cameras = tuple(camera for camera in rig.cameras if camera.name in paths)
        return Moment(cameras, tuple(paths[camera.name] for camera in cameras), speed_mps)


@dataclass(frozen=True)
class MomentPlan:
    """What a planner says of a moment.

    Attributes:
        probabilities: [K] of its templates.
        order: [K] templates, the most probable first.
        cost_map: [X, Y] low is good; of a cost volume the mean over times.
    """

    probabilities: NDArray[np.float32]
    order: NDArray[np.int64]
    cost_map: NDArray[np.float32]


def plan_moment(run: PlainRun, moment: Moment) -> MomentPlan:
    """Rank a planner's templates by what cameras see.

    Raises:
        DataError: If an image cannot be read, or the planner cannot plan from it.
    """
    _check_kind(run, moment)
    batch = collate([_read(run, moment)]).to(next(run.planner.parameters()).device)
    with torch.no_grad():
        maps = run.planner.cost_maps(batch)
        probabilities = run.planner.scores(maps).softmax(dim=-1)[0].float().cpu().numpy()
    if not np.isfinite(probabilities).all():
        raise DataError(f"The planner in '{run.folder}' gives no finite scores; train it again.")
    order = np.argsort(-probabilities, kind="stable")
    return MomentPlan(probabilities, order, maps[0].mean(dim=0).float().cpu().numpy())


def strange_lenses(run: PlainRun, moment: Moment) -> list[str]:
    """Sentences on cameras whose lenses are far from all that the planner has seen in training.

    An image is scaled until it fills the network's; through such a lens all things then are larger
    or smaller than they were. Nothing is said where a run does not tell what it has seen.
    """
    seen = FocalLengths.load(run.folder)
    if seen is None:
        return []
    told = []
    for camera in moment.cameras:
        focal_px = network_focal_px(
            camera.rawpixel_from_camera, camera.image_hw, run.config.data.image
        )
        if not seen.low_px / _STRANGE_FACTOR <= focal_px <= seen.high_px * _STRANGE_FACTOR:
            told.append(
                f"Camera '{camera.name}' has a focal length of {focal_px:.0f} px in the network's "
                f"image; in training there were {seen.low_px:.0f} to {seen.high_px:.0f} px."
            )
    return told


def describe_plan(
    run: PlainRun, moment: Moment, plan: MomentPlan, num: int, note: str | None = None
) -> dict[str, Any]:
    """A plan as JSON has it: the most probable templates and what they belong to.

    Args:
        run: Who planned.
        moment: From what.
        plan: What it said.
        num: How many templates; all if there are fewer.
        note: A sentence on what the planner was trained on.
    """
    points, dt_s = run.templates.points, run.templates.dt_s
    data = run.config.data
    return {
        "frame": FRAME,
        "times_s": [round(dt_s * step, 6) for step in range(1, points.shape[1] + 1)],
        "cameras": {
            camera.name: {
                "image": str(path),
                "intrinsics": camera.rawpixel_from_camera.tolist(),
                "ego_from_camera": pose.tolist(),
            }
            for camera, path, pose in zip(
                moment.cameras, moment.paths, _poses(run, moment), strict=True
            )
        },
        "speed_mps": moment.speed_mps,
        "planner": {
            "run": run.folder.resolve().name,
            "weights_sha256": run.digest,
            "templates_sha256": run.templates.sha256,
            "num_templates": len(points),
            "trained_on": {
                "data": Path(data.root).name,
                "version": data.version,
                "split": run.config.train_split,
                "note": note,
            },
        },
        "ranked": [
            {
                "rank": rank,
                "template": int(k),
                "probability": float(plan.probabilities[k]),
                "points_m": [[round(float(side), 4) for side in point] for point in points[k]],
            }
            for rank, k in enumerate(plan.order[:num], start=1)
        ],
    }


def _check_kind(run: PlainRun, moment: Moment) -> None:
    data = run.config.data
    if data.lidar_scans:
        raise DataError(f"The planner in '{run.folder}' sees lidar scans, no images.")
    if run.config.model.lift == "cnn" and len(moment.cameras) != len(data.cameras):
        raise DataError(
            f"The planner in '{run.folder}' knows no calibration (its lift is 'cnn'), so it needs "
            f"the {len(data.cameras)} cameras that it was trained on, in their order, not "
            f"{len(moment.cameras)}."
        )


def _read(run: PlainRun, moment: Moment) -> Batch:
    views = [
        View(
            load=partial(load_image, path),
            image_hw=camera.image_hw,
            rawpixel_from_camera=camera.rawpixel_from_camera,
            egocam_from_camera=camera.ego_from_camera,
            ego_from_camera=pose,
        )
        for camera, path, pose in zip(
            moment.cameras, moment.paths, _poses(run, moment), strict=True
        )
    ]
    return read_views(views, run.config.data.image)


def _poses(run: PlainRun, moment: Moment) -> list[NDArray[np.float64]]:
    """As the planner was trained: each at its camera's own time, or as mounted."""
    if run.config.data.ego_motion:
        return list(moment.ego_from_camera)
    return [camera.ego_from_camera for camera in moment.cameras]
