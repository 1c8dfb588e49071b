"""What a run keeps of the samples it was trained on: all that baselines are fitted to.

So they can be fitted again wherever the run goes, without the data it was trained on.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.npz import UNREADABLE, read_npz
from shoot.templates import TemplateSet
from shoot.training.planning.data import LabelledSplit
from shoot.trajectories import Futures

# A million samples take some 200 MB.
_MAX_BYTES = 1 << 28
_PAST = ("velocity_mps", "yaw_rate_radps", "past_xy_m", "past_known")


@dataclass(frozen=True)
class TrainingMotion:
    """Labels of the training samples, and how the ego came to where they start.

    Attributes:
        past: Of which only the past is there: its paths have no points (T = 0), and its rows of
            samples mean nothing.
        labels: [S] nearest templates.
        scene_token: [C] of the scenes that `past.scene` counts.
    """

    past: Futures
    labels: NDArray[np.int64]
    scene_token: NDArray[np.character]

    @staticmethod
    def of(split: LabelledSplit) -> "TrainingMotion":
        """That of a split."""
        scenes, scene = np.unique(split.futures.scene, return_inverse=True)
        arrays = {name: getattr(split.futures, name) for name in _PAST}
        return TrainingMotion(
            _past_alone(scene, arrays), split.labels, split.index.scene_token[scenes]
        )

    def save(self, path: Path) -> None:
        """Write it (.npz, no pickle), in single precision.

        Raises:
            OSError: If it cannot be written.
        """
        past = {name: getattr(self.past, name) for name in _PAST}
        with write_atomically(path) as stream:
            np.savez_compressed(
                stream,
                labels=self.labels.astype(np.int32),
                scene=self.past.scene.astype(np.int32),
                scene_token=self.scene_token,
                **{n: a if a.dtype == bool else a.astype(np.float32) for n, a in past.items()},
            )

    @staticmethod
    def load(path: Path, templates: TemplateSet) -> "TrainingMotion":
        """Read what `save` wrote.

        Args:
            path: Of the file.
            templates: That the labels are among.

        Raises:
            DataError: If there is no such file, or it does not fit.
        """
        if not path.is_file():
            raise DataError(
                f"'{path.parent}' lacks {path.name}, which its baselines are fitted to; "
                "shoot-train --resume with the run's own settings writes it."
            )
        try:
            stored = read_npz(path, _MAX_BYTES)
            labels, scene = stored["labels"], stored["scene"]
            _check(stored, len(templates.points))
        except UNREADABLE as error:
            raise DataError(
                f"'{path}' does not hold a run's training labels and past motion: {error}"
            ) from error
        past = {name: _wide(stored[name]) for name in _PAST}
        return TrainingMotion(
            _past_alone(scene.astype(np.int64), past),
            labels.astype(np.int64),
            stored["scene_token"],
        )


def _past_alone(scene: NDArray[np.int64], past: dict[str, NDArray[Any]]) -> Futures:
    num = len(scene)
    return Futures(
        xy_m=np.zeros((num, 0, 2)),
        scene=scene,
        sample=np.full(num, -1),
        velocity_mps=past["velocity_mps"],
        yaw_rate_radps=past["yaw_rate_radps"],
        past_xy_m=past["past_xy_m"],
        past_known=past["past_known"],
        num_left_out=0,
    )


def _wide(array: NDArray[Any]) -> NDArray[Any]:
    return array if array.dtype == bool else array.astype(np.float64)


def _check(stored: dict[str, NDArray[Any]], num_templates: int) -> None:
    """Check types, shapes and values.

    Raises:
        ValueError: If they are not as they were written.
    """
    num = len(stored["labels"])
    shapes = {
        "labels": (num,),
        "scene": (num,),
        "scene_token": (len(stored["scene_token"]),),
        "velocity_mps": (num, 2),
        "yaw_rate_radps": (num,),
        "past_xy_m": (num, *stored["past_xy_m"].shape[1:2], 2),
        "past_known": stored["past_xy_m"].shape[:2],
    }
    kinds = dict.fromkeys(shapes, "f") | {
        "labels": "i", "scene": "i", "scene_token": "U", "past_known": "b",
    }  # fmt: skip
    for name, shape in shapes.items():
        array = stored[name]
        if array.shape != shape or array.dtype.kind != kinds[name]:
            raise ValueError(f"its {name} are {array.dtype} {array.shape}")
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise ValueError(f"its {name} are not finite")
    for name, count in (("labels", num_templates), ("scene", len(stored["scene_token"]))):
        if num == 0 or stored[name].min() < 0 or stored[name].max() >= count:
            raise ValueError(f"its {name} do not lie in 0..{count - 1}")
