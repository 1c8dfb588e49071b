"""Everything one picture of one sample's segmentation shows, and in which order classes lie."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.colors import to_rgb

from lss_core.grid import BevGrid
from shoot.rendering import palette
from shoot.rendering.sample_view import FloatArray, check_cameras

ByteArray = np.ndarray[Any, np.dtype[np.uint8]]


@dataclass(frozen=True)
class SegmentationView:
    """One sample as arrays.

    Attributes:
        images: One RGB image per camera.
        pixel_from_camera: Intrinsics for exactly these images.
        ego_from_camera: Pose of each camera in `ego`.
        camera_names: Name per image.
        grid: Cells of the maps.
        classes: Names of the channels.
        probabilities: Of each class in each cell; X forward, Y left.
        truth: 1 where a cell is of a class.
        iou: Of each class on this sample alone, in per cent; NaN where there is none.
        threshold: Probability from which on a cell is said to be of a class.
        title: Headline.
        caption: Small print below it.

    Raises:
        ValueError: If sizes do not belong together.
    """

    images: UInt8[ByteArray, "N H W 3"]
    pixel_from_camera: Float[FloatArray, "N 3 3"]
    ego_from_camera: Float[FloatArray, "N 4 4"]
    camera_names: tuple[str, ...]
    grid: BevGrid
    classes: tuple[str, ...]
    probabilities: Float[FloatArray, "C X Y"]
    truth: UInt8[ByteArray, "C X Y"]
    iou: tuple[float, ...]
    threshold: float = 0.5
    title: str = ""
    caption: str = ""

    def __post_init__(self) -> None:
        check_cameras(self.camera_names, self.images, self.pixel_from_camera, self.ego_from_camera)
        if len(self.iou) != len(self.classes):
            raise ValueError(f"{len(self.classes)} classes need as many IoUs, got {len(self.iou)}.")
        shape = (len(self.classes), *self.grid.shape)
        if not self.probabilities.shape == self.truth.shape == shape:
            raise ValueError(
                f"Maps of {len(self.classes)} classes on the grid have the shape {shape}, got "
                f"{self.probabilities.shape} and {self.truth.shape}."
            )


def class_colour(name: str) -> str:
    """Colour of a class; ink for one without a colour of its own."""
    return palette.CLASSES.get(name, palette.INK)


def order_of_layers(classes: Sequence[str]) -> list[int]:
    """Channels from the one that lies lowest on: road, lanes, vehicles, cars, then all others."""
    places = {name: place for place, name in enumerate(palette.CLASSES)}
    return sorted(range(len(classes)), key=lambda c: places.get(classes[c], len(places)))


def blend_classes(
    values: Float[FloatArray, "C X Y"], classes: Sequence[str]
) -> Float[FloatArray, "X Y 3"]:
    """Colour of each cell: the more probable a class, the less is seen of what lies below it."""
    colours: FloatArray = np.ones((*values.shape[1:], 3))
    for c in order_of_layers(classes):
        opacity = values[c][..., None]
        colours = (1.0 - opacity) * colours + opacity * np.array(to_rgb(class_colour(classes[c])))
    return colours


def topmost_class(
    probabilities: Float[FloatArray, "C X Y"], classes: Sequence[str], threshold: float
) -> Int[np.ndarray[Any, np.dtype[np.int64]], "X Y"]:
    """Channel that lies topmost among those that a cell is said to be of; -1 for none."""
    top = np.full(probabilities.shape[1:], -1, dtype=np.int64)
    for c in order_of_layers(classes):
        top[probabilities[c] >= threshold] = c
    return top
