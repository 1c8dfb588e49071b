"""A sample's images at a readable size, and what stands above its picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lss_core.data.dataset import raw_hw
from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.images import PixelMap, load_image
from lss_core.geometry import FloatArray
from lss_core.legible import legible

_SHOWN_WIDTH_PX = 800
# Letters of a title: a long one leaves no room for the picture.
_SHOWN = 400


def title_of(index: SampleIndex, row: int) -> str:
    """The scene and its description."""
    scene = int(index.sample_scene[row])
    return legible(f"{index.scene_name[scene]}: {index.scene_description[scene]}"[:_SHOWN])


def caption_of(index: SampleIndex, row: int) -> str:
    """Which sample it is."""
    return legible(f"sample {index.sample_token[row]}")


def shown_images(
    index: SampleIndex, root: Path, row: int
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.uint8]], FloatArray, tuple[str, ...], list[int]]:
    """Whole images at a readable size, their intrinsics, names, and which cameras they are of.

    Where cameras differ, the smaller images have black borders.
    """
    there = [int(n) for n in np.flatnonzero(index.has_camera[row])]
    images, intrinsics = whole_images(
        [root / index.image_path[row, n] for n in there],
        [raw_hw(index, root, row, n) for n in there],
        index.rawpixel_from_camera[row, there],
    )
    names = tuple(legible(str(index.cameras[n])) for n in there)
    return images, intrinsics, names, there


def whole_images(
    paths: Sequence[Path], raw_hws: Sequence[tuple[int, int]], rawpixel_from_camera: FloatArray
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.uint8]], FloatArray]:
    """Whole images at a readable size, and their intrinsics.

    Where sizes differ, the smaller images have black borders.

    Args:
        paths: Of N files.
        raw_hws: Their heights and widths.
        rawpixel_from_camera: [N, 3, 3].

    Raises:
        DataError: If one is missing or damaged.
    """
    shown_hws = [_shown_hw(*sides_px) for sides_px in raw_hws]
    frame_hw = max(height for height, _ in shown_hws), max(width for _, width in shown_hws)
    images, intrinsics = [], []
    for n, (height, width) in enumerate(shown_hws):
        left, top = (width - frame_hw[1]) // 2, (height - frame_hw[0]) // 2
        pixel_map = PixelMap((height, width), left, top, False, 0.0, frame_hw, raw_hws[n])
        images.append(load_image(paths[n], pixel_map))
        intrinsics.append(pixel_map.pixel_from_rawpixel @ rawpixel_from_camera[n])
    return np.stack(images), np.stack(intrinsics)


def _shown_hw(raw_h: int, raw_w: int) -> tuple[int, int]:
    scale = min(1.0, _SHOWN_WIDTH_PX / raw_w)
    return max(1, round(raw_h * scale)), max(1, round(raw_w * scale))
