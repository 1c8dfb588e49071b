from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from shoot.world.nuscenes.map_lanes import arcline_path
from shoot.world.nuscenes.map_masks import write_mask
from shoot.world.nuscenes.tiling import TILE_M


def test_masks_are_joined_with_north_up(tmp_path: Path):
    side = round(TILE_M / 0.1)
    tile = np.zeros((side, side), np.uint8)
    tile[:10, :20] = 255  # lower left corner of the town
    cv2.imwrite(str(tmp_path / "tile.png"), tile)
    write_mask(tmp_path / "map.png", {(1, 0): tmp_path / "tile.png"}, 2, 1)
    with Image.open(tmp_path / "map.png") as image:
        assert image.mode == "L"
        mask = np.asarray(image)
    assert mask.shape == (side, 2 * side)
    assert np.all(mask[-10:, side : side + 20] == 255)
    assert mask.sum() == 255 * 200


def test_arc_lines_follow_their_polyline():
    from nuscenes.map_expansion.arcline_path_utils import discretize_lane

    turn = np.linspace(0, np.pi / 2, 40)
    curve = 10 * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=1) + [5.0, 7.0]
    walked = np.array(discretize_lane(arcline_path(curve), 0.25))
    radius = np.hypot(walked[:, 0] - 5.0, walked[:, 1] - 17.0)
    assert np.abs(radius - 10).max() < 0.08
    assert walked[0, :2] == pytest.approx([5, 7], abs=0.01)
    assert walked[-1, :2] == pytest.approx([15, 17], abs=0.3)
