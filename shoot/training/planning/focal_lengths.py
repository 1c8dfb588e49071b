"""How long the lenses were that a planner was trained with, as its network sees them."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lss_core.config import ImageConfig
from lss_core.data.sensors.images import draw_pixel_map
from lss_core.geometry import FloatArray
from lss_core.strict_json import save_json
from shoot.training.split import SampleSplit

FILE = "training_cameras.json"


def network_focal_px(
    rawpixel_from_camera: FloatArray, raw_hw: tuple[int, int], image: ImageConfig
) -> float:
    """Horizontal focal length in pixels of the network's image.

    Args:
        rawpixel_from_camera: [3, 3].
        raw_hw: Height and width of the camera's image.
        image: What the network takes.
    """
    resized_w = draw_pixel_map(image, raw_hw, None).resized_hw[1]
    return float(rawpixel_from_camera[0, 0] * resized_w / raw_hw[1])


@dataclass(frozen=True)
class FocalLengths:
    """The shortest and the longest lens of all training samples.

    Attributes:
        low_px: In pixels of the network's image.
        high_px: Likewise.
    """

    low_px: float
    high_px: float

    @staticmethod
    def of(split: SampleSplit, image: ImageConfig) -> "FocalLengths | None":
        """Those of a split's samples; None if the tables tell no size of an image.

        Args:
            split: Samples.
            image: What the network takes.
        """
        index, rows = split.index, np.unique(split.rows)
        hw = index.image_hw[rows].reshape(-1, 2)
        focal_px = index.rawpixel_from_camera[rows, :, 0, 0].reshape(-1)
        is_known = index.has_camera[rows].reshape(-1) & (hw > 0).all(axis=-1)
        cameras = np.unique(np.column_stack([hw, focal_px])[is_known], axis=0)
        if not len(cameras):
            return None
        seen = [
            network_focal_px(np.diag([focal, focal, 1.0]), (int(height), int(width)), image)
            for height, width, focal in cameras
        ]
        return FocalLengths(min(seen), max(seen))

    def save(self, folder: Path) -> None:
        """Write them into a run folder.

        Raises:
            OSError: If they cannot be written.
        """
        save_json({"focal_px": [self.low_px, self.high_px]}, folder / FILE)

    @staticmethod
    def load(folder: Path) -> "FocalLengths | None":
        """Those of a run; None if it is older than the file, or the file tells nothing."""
        try:
            low_px, high_px = json.loads((folder / FILE).read_text(encoding="utf-8"))["focal_px"]
            return FocalLengths(float(low_px), float(high_px))
        except (OSError, ValueError, TypeError, KeyError):
            return None
