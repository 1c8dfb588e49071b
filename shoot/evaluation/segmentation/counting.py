"""Cells counted while maps pass by: memory grows with the number of scenes, not of samples."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from lss_core.grid import BevGrid
from shoot.metrics.overlap import NUM_BINS, THRESHOLD, count_by_probability

Array = np.ndarray[Any, np.dtype[Any]]

RING_M = 10.0


@dataclass(frozen=True)
class CellCounts:
    """What maps say of cells, and what is there, scene by scene.

    Attributes:
        scene: Rows of N scenes in the index.
        num_samples: Samples of each.
        by_probability: Cells in each bin of probability, see `count_by_probability`.
        by_ring: True positives, false positives and false negatives in each ring of distance.
    """

    scene: Int[Array, " N"]
    num_samples: Int[Array, " N"]
    by_probability: Int[Array, "N C J 2"]
    by_ring: Int[Array, "N C R 3"]


class CellCounter:
    """Adds maps up.

    Args:
        scenes: Rows of the scenes that there will be maps of.
        num_classes: Channels of the maps.
        grid: Their cells.
    """

    def __init__(self, scenes: Int[Array, " S"], num_classes: int, grid: BevGrid) -> None:
        self._scene = np.unique(scenes)
        self._ring = rings_of_cells(grid)
        num_scenes, num_rings = len(self._scene), len(name_rings(grid))
        self._num_samples = np.zeros(num_scenes, dtype=np.int64)
        self._by_probability = np.zeros((num_scenes, num_classes, NUM_BINS, 2), dtype=np.int64)
        self._by_ring = np.zeros((num_scenes, num_classes, num_rings, 3), dtype=np.int64)

    def add(
        self,
        prob: Float[Array, "B C X Y"],
        truth: UInt8[Array, "B C X Y"],
        scenes: Int[Array, " B"],
    ) -> None:
        """Add a batch.

        Args:
            prob: Probability of each class in each cell.
            truth: 1 where a cell is of a class.
            scenes: Row of each sample's scene.
        """
        for b, n in enumerate(np.searchsorted(self._scene, scenes)):
            self._num_samples[n] += 1
            for c in range(prob.shape[1]):
                self._by_probability[n, c] += count_by_probability(prob[b, c], truth[b, c])
                self._by_ring[n, c] += self._count_in_rings(prob[b, c], truth[b, c])

    def counts(self) -> CellCounts:
        """Of all that was added."""
        return CellCounts(self._scene, self._num_samples, self._by_probability, self._by_ring)

    def _count_in_rings(
        self, prob: Float[Array, "X Y"], truth: UInt8[Array, "X Y"]
    ) -> Int[Array, "R 3"]:
        num_rings = self._by_ring.shape[2]
        kind = 4 * self._ring + 2 * (prob >= THRESHOLD) + truth
        counts: Array = np.bincount(kind.ravel(), minlength=4 * num_rings)
        # Said and true, said only, true only.
        return counts.reshape(num_rings, 4)[:, [3, 2, 1]]


def rings_of_cells(grid: BevGrid) -> Int[Array, "X Y"]:
    """Which ring of 10 m around the car each cell's centre lies in, from 0; near edge in, far out.

    Around the origin of `ego`. The farthest rings are cut by the map's border.
    """
    distance_m = np.linalg.norm(grid.centres().double().numpy(), axis=-1)
    ring: Array = np.floor(distance_m / RING_M).astype(np.int64)
    return ring


def name_rings(grid: BevGrid) -> list[str]:
    """Names of the rings, from the nearest on."""
    edges_m = RING_M * np.arange(int(rings_of_cells(grid).max()) + 2)
    return [f"{near:g}-{far:g} m" for near, far in itertools.pairwise(edges_m)]
