"""Samples of a split that a task can use, and whose they are."""

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from lss_core.data.drives import KnownScene, know_scenes
from lss_core.data.samples import SampleIndex
from lss_core.data.usable import LeftOut


class SampleSplit(ABC):
    """Those of a task have their targets beside them.

    Attributes:
        index: Of the data set.
        left_out: Keyframes that cannot be used.
    """

    index: SampleIndex
    left_out: tuple[LeftOut, ...]

    @property
    @abstractmethod
    def rows(self) -> NDArray[np.int64]:
        """[S] rows of the samples in the index."""

    @property
    @abstractmethod
    def num_left_out(self) -> int:
        """Keyframes of its scenes that have no target, or cannot be used."""

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def scene_rows(self) -> NDArray[np.int64]:
        """[S] row of each sample's scene in the index."""
        scenes: NDArray[np.int64] = self.index.sample_scene[self.rows]
        return scenes

    @property
    def scene_names(self) -> NDArray[np.character]:
        """[S] name of each sample's scene."""
        names: NDArray[np.character] = self.index.scene_name[self.scene_rows]
        return names

    @property
    def scene_tokens(self) -> NDArray[np.character]:
        """[S] token of each sample's scene."""
        tokens: NDArray[np.character] = self.index.scene_token[self.scene_rows]
        return tokens

    @property
    def scenes(self) -> tuple[KnownScene, ...]:
        """The samples' scenes, as they can be met again."""
        return know_scenes(self.index, np.unique(self.scene_rows).tolist())

    @property
    def logs(self) -> NDArray[np.character] | None:
        """[S] log of each sample's scene; None if no log of the data set holds several scenes."""
        if len(np.unique(self.index.scene_log)) == len(self.index.scene_log):
            return None
        logs: NDArray[np.character] = self.index.scene_log[self.scene_rows]
        return logs
