"""Labels of samples on a grid: where cars, vehicles, drivable area and lane boundaries are."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from lss_core.data.samples import SampleIndex, load_index
from lss_core.geometry import FloatArray
from lss_core.grid import BevGrid
from lss_core.labels.classes import CLASSES, MAP_CLASSES, OBJECT_CLASSES, check_names
from lss_core.labels.objects import SeenBoxes, read_seen_boxes
from lss_core.labels.raster import Mask, draw_rounded, fill_centres, fill_rounded
from lss_core.labels.roads import LINE_WIDTH_M, Layer, load_drivable, load_lane_boundaries
from lss_core.labels.shapes import Shapes, quadrangles


class LabelReader:
    """Makes the labels of samples, from boxes and maps that are read once; can be pickled.

    Paper: section 5.1. Deviation: classes, widths and borders, see docs/deviations.md.

    Args:
        index: Of the data set.
        root: Of the data set.
        version: Of its tables.
        rows: [S] of the samples that will be asked for, in the index.
        grid: Cells of the ego frame's ground plane.
        classes: Channels, among `CLASSES`.
        rule: `centre`: a cell is of a class if its centre is; `released`: corners rounded to cells,
            borders included, as the released code has it.

    Raises:
        DataError: If a class or the rule is unknown, annotations or maps are not there or damaged,
            or a map has no dividers.
    """

    def __init__(
        self,
        index: SampleIndex,
        root: Path,
        version: str,
        rows: NDArray[np.int64],
        grid: BevGrid,
        classes: tuple[str, ...] = CLASSES,
        rule: str = "centre",
    ) -> None:
        check_names(classes, rule)
        self.classes, self.rule, self.grid = classes, rule, grid
        self._rows = np.unique(rows)
        self._global_from_ego: FloatArray = index.global_from_ego[self._rows]
        self._location = index.scene_location[index.sample_scene[self._rows]]
        self._corners_m = np.array(
            [(x, y) for x in (grid.x_min_m, grid.x_max_m) for y in (grid.y_min_m, grid.y_max_m)]
        )
        self._objects = tuple(name for name in classes if name in OBJECT_CLASSES)
        self._boxes: SeenBoxes | None = None
        if self._objects:
            self._boxes = read_seen_boxes(root / version, index, self._rows, self._objects)
        self._layers: dict[tuple[str, str], Layer] = {}
        for location in np.unique(self._location).tolist():
            if "drivable" in classes:
                self._layers[location, "drivable"] = load_drivable(root, location)
            if "lane_boundary" in classes:
                lines, strips = load_lane_boundaries(root, location)
                self._layers[location, "lane_boundary"] = strips if rule == "centre" else lines

    def read(self, row: int) -> Mask:
        """[C, X, Y] 1 where a sample has a class, 0 elsewhere.

        Args:
            row: Of the sample in the index.

        Raises:
            KeyError: If it is none of the rows that the reader was made for.
        """
        position = int(np.searchsorted(self._rows, row))
        if position == len(self._rows) or self._rows[position] != row:
            raise KeyError(f"The labels of sample {row} were not asked for.")
        return np.stack([self._mask(position, row, name) for name in self.classes])

    def _mask(self, position: int, row: int, name: str) -> Mask:
        if name in MAP_CLASSES:
            layer = self._layers[str(self._location[position]), name]
            shapes = layer.around(self._global_from_ego[position], self._corners_m)
        else:
            assert self._boxes is not None
            own = self._boxes.of_sample(row)
            is_class = self._boxes.is_class[own, self._objects.index(name)]
            shapes = quadrangles(self._boxes.corners_m[own][is_class])
        return self._cells(shapes, is_line=name == "lane_boundary")

    def _cells(self, shapes: Shapes, is_line: bool) -> Mask:
        """[X, Y] cells of shapes in metres in `ego`."""
        place = self.grid.continuous_cells(torch.from_numpy(shapes.points)).numpy()
        in_cells = shapes.moved(place)
        if self.rule == "centre":
            return fill_centres(in_cells, self.grid.shape)
        if is_line:
            width = max(1, round(LINE_WIDTH_M / self.grid.cell_m))
            return draw_rounded(in_cells, width, self.grid.shape)
        return fill_rounded(in_cells, self.grid.shape)


def sample_labels(
    root: str | Path,
    version: str,
    sample_token: str,
    grid: BevGrid,
    classes: Sequence[str] = CLASSES,
    rule: str = "centre",
) -> dict[str, Mask]:
    """Class -> [X, Y] 1 where a sample has it, 0 elsewhere; many samples are for `LabelReader`.

    Args:
        root: Of a data set in nuScenes' format.
        version: Of its tables, as `v1.0-trainval`.
        sample_token: Of a keyframe.
        grid: Cells of the ego frame's ground plane at the keyframe's lidar time.
        classes: Among `CLASSES`.
        rule: `centre` or `released`, see `LabelReader`.

    Raises:
        DataError: If the sample or a class is unknown, tables or maps are missing or damaged.
    """
    index = load_index(root, version, ())
    row = index.row_of(sample_token)
    rows = np.array([row], dtype=np.int64)
    reader = LabelReader(index, Path(root), version, rows, grid, tuple(classes), rule)
    return dict(zip(reader.classes, reader.read(row), strict=True))
