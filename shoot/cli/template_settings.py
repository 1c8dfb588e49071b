"""What shoot-fit-templates is told."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from lss_core.bounds import Bounds, Seed, SettingError, check_settings
from lss_core.config import CAMERAS, check_cameras
from shoot.templates.methods import Method
from shoot.trajectories import DT_S, HORIZON_S, whole_steps

NumTemplates = Annotated[int, Bounds(1, 1_000_000)]


@dataclass(frozen=True)
class DataSource:
    """Where tables are.

    Attributes:
        root: Folder that holds the version's folder; only a vocabulary does without.
        version: Name of the tables' folder.
        cameras: Channels, as in training: both then share one cached index.
        skip_bad: Leave out scenes whose poses cannot be, count and list them, instead of stopping.
    """

    root: str | None = None
    version: str = "v1.0-trainval"
    cameras: tuple[str, ...] = CAMERAS
    skip_bad: bool = False

    def __post_init__(self) -> None:
        check_settings(self)
        check_cameras(self.cameras)


@dataclass(frozen=True)
class FitTemplatesConfig:
    """Fit templates to the ego trajectories of a split, or take them from a vocabulary.

    Attributes:
        data: Where tables are.
        out: Template file to write (.npz); its card (.json) and picture (.png) appear beside it.
        horizon_s: Length of the trajectories: 5 s, or that of the vocabulary.
        dt_s: Time between their points, the first of which is as late: 0.25 s. A vocabulary does
            not tell its own, so it must be given.
        vocabulary: Take the trajectories of another planner instead of fitting: an array of numpy
            (.npy), K x T x 2 (x, y), K x T x 3 (x, y, heading) or that flattened to K x 3 T, in
            metres, x forward and y left. With a data set, its futures are counted on them.
        export: Write the templates as such an array, too (.npy): float32, K x T x 3 (x, y, heading
            in radians). The heading is the direction of travel, kept where the car stands.
        split: Scenes to fit on, or to count.
        coverage_split: Scenes to measure coverage on as well, if the data set has them.
        k: Number of templates to fit.
        method: How: K-Means; farthest points; a cover, within the smallest distance that K
            trajectories can keep from all; K-medoids; or paths times speed profiles. See
            docs/templates.md.
        seed: Of K-Means; farthest points and covers have no chance in them.
        stream: Never hold all futures at once: mini-batch K-Means, 50 scenes at a time, for data
            sets whose futures do not fit into memory. The card says what is given up at most.
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then mine the futures.
    """

    data: DataSource
    out: str
    horizon_s: Annotated[float | None, Bounds(0.01, 60.0)] = None
    dt_s: Annotated[float | None, Bounds(0.01, 10.0)] = None
    vocabulary: Annotated[str | None, tyro.conf.arg(name="from")] = None
    export: str | None = None
    split: str = "train"
    coverage_split: str = "val"
    k: NumTemplates = 1000
    method: Method = "kmeans"
    seed: Seed = 0
    stream: bool = False
    dask: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)
        if self.vocabulary is not None:
            if self.dt_s is None:
                raise SettingError(
                    "dt_s is not given, but a vocabulary does not tell the time between its "
                    "points: at 10 Hz, --dt-s 0.1."
                )
        elif self.stream and self.method != "kmeans":
            raise SettingError(
                f"stream is set, but '{self.method}' needs all futures at once; only kmeans takes "
                "them as a stream."
            )
        elif self.data.root is None:
            raise SettingError(
                "data.root is not given; name the data set to fit to, or a vocabulary (--from)."
            )
        elif whole_steps(self.length_s, self.step_s) is None:
            raise SettingError(
                f"horizon_s is {self.length_s:g}, but must be a whole number of steps of dt_s, "
                f"{self.step_s:g}."
            )

    @property
    def step_s(self) -> float:
        """Time between points."""
        return DT_S if self.dt_s is None else self.dt_s

    @property
    def length_s(self) -> float:
        """Length of trajectories that are fitted."""
        return HORIZON_S if self.horizon_s is None else self.horizon_s
