"""Towns as drivable-surface masks."""

import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lss_core.files import write_atomically
from shoot.world.looks.paint import polygons_of
from shoot.world.nuscenes.tiling import TILE_M
from shoot.world.town.town import Town

MASK_CELL_M = 0.1


def town_mask(town: Town) -> NDArray[np.uint8]:
    """Where a town is road or pavement: 255, else 0; [S, S], one tile, row 0 at its lower edge."""
    side = round(TILE_M / MASK_CELL_M)
    mask = np.zeros((side, side), np.uint8)
    for surface in (town.pavement, town.road):
        for part in polygons_of(surface):
            rings = [
                np.round(np.asarray(ring.coords) / MASK_CELL_M * 16 - 8).astype(np.int32)
                for ring in (part.exterior, *part.interiors)
            ]
            # All rings at once: inside then means in an odd number of them, and holes stay free.
            cv2.fillPoly(mask, rings, 255, cv2.LINE_8, 4)
    return mask


def write_mask(path: Path, tiles: dict[tuple[int, int], Path], columns: int, rows: int) -> None:
    """Join the masks of towns (PNG files by (column, row)) into one PNG, north up.

    The file is written band by band with two bits a pixel, which readers expand to 0 and 255: a map
    of a hundred towns has a thousand million pixels and would not fit into memory.
    """
    side = round(TILE_M / MASK_CELL_M)

    def bands() -> Iterator[bytes]:
        for row in reversed(range(rows)):
            band = np.zeros((side, columns * side), np.uint8)
            for column in range(columns):
                if (column, row) in tiles:
                    tile = cv2.imread(str(tiles[column, row]), cv2.IMREAD_GRAYSCALE)
                    band[:, column * side : (column + 1) * side] = tile[::-1] >= 128
            quarters = (band * np.uint8(3)).reshape(side, -1, 4)
            packed = (
                quarters[..., 0] << 6
                | quarters[..., 1] << 4
                | quarters[..., 2] << 2
                | quarters[..., 3]
            )
            # Each line starts with its filter: 0, none.
            yield np.pad(packed, ((0, 0), (1, 0))).astype(np.uint8).tobytes()

    _write_png(path, columns * side, rows * side, bands())


def _write_png(path: Path, width: int, height: int, bands: Iterator[bytes]) -> None:
    """Write a grey PNG of two bits a pixel from packed, filtered lines."""

    def piece(kind: bytes, content: bytes) -> bytes:
        check = zlib.crc32(kind + content)
        return len(content).to_bytes(4, "big") + kind + content + check.to_bytes(4, "big")

    squeeze = zlib.compressobj(6)
    with write_atomically(path) as stream:
        stream.write(b"\x89PNG\r\n\x1a\n")
        size = width.to_bytes(4, "big") + height.to_bytes(4, "big")
        stream.write(piece(b"IHDR", size + bytes([2, 0, 0, 0, 0])))
        for band in bands:
            content = squeeze.compress(band)
            if content:
                stream.write(piece(b"IDAT", content))
        stream.write(piece(b"IDAT", squeeze.flush()))
        stream.write(piece(b"IEND", b""))
