"""What a report on a data set says, as plain values: metres, seconds, degrees, shares of one."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lss_core.geometry import FloatArray
from lss_core.strict_json import save_json, without_nan

Level = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Spread:
    """How numbers are spread; NaN where there is none.

    Attributes:
        median, least, most: Of all of them.
        low, high: 5 % lie below, 5 % above.
    """

    median: float
    least: float
    most: float
    low: float
    high: float

    @staticmethod
    def of(values: FloatArray | NDArray[np.int64]) -> "Spread":
        """Of numbers in an array of any shape."""
        if not values.size:
            return Spread(*[float("nan")] * 5)
        quantiles = np.quantile(values, [0.5, 0.0, 1.0, 0.05, 0.95])
        return Spread(*[float(number) for number in quantiles])


@dataclass(frozen=True)
class SplitFacts:
    """The scenes of a split.

    Attributes:
        name: Of the split.
        is_own: Whether `splits.json` lists it, rather than nuScenes.
        num_listed: Scenes that its list names.
        num_scenes, num_samples: How many of these are there.
        missing: Names of the first few that are not.
    """

    name: str
    is_own: bool
    num_listed: int
    num_scenes: int
    num_samples: int
    missing: tuple[str, ...]


@dataclass(frozen=True)
class DriveFacts:
    """Scenes and the poses in them.

    Attributes:
        num_scenes, num_logs, num_samples, num_poses: How many; logs are drives that scenes were cut
            from.
        num_scenes_in_no_split: Of the splits listed.
        splits: Of `splits.json`, or those official lists that name a scene of the data set.
        first, last: Dates (UTC) of the first and the last pose; empty without poses.
        keyframe_step_s: Time from one keyframe of a scene to the next.
        pose_step_s: Time from one pose of a scene to the next.
        num_gaps: Steps between poses of more than three times the usual one.
    """

    num_scenes: int
    num_logs: int
    num_samples: int
    num_poses: int
    num_scenes_in_no_split: int
    splits: tuple[SplitFacts, ...]
    first: str
    last: str
    keyframe_step_s: Spread
    pose_step_s: Spread
    num_gaps: int


@dataclass(frozen=True)
class MotionFacts:
    """How the car moves, over half a second at a time.

    Attributes:
        hours: Time in all.
        speed_mps: Of all half seconds.
        standing: Share slower than 0.2 m/s.
        reversing: Share in which the car moves against its x axis, faster than that.
        turning: Share with a yaw rate above 0.05 rad/s.
        off_axis_deg: Direction of motion seen from the ego's x axis, left is positive, where the
            car is faster than 2 m/s.
        num_off_axis: Half seconds faster than that.
        tilt_deg: Between the ego's z axis and that of `global`, over all poses.
    """

    hours: float
    speed_mps: Spread
    standing: float
    reversing: float
    turning: float
    off_axis_deg: Spread
    num_off_axis: int
    tilt_deg: Spread


@dataclass(frozen=True)
class FutureFacts:
    """What has the paper's 5 s of recorded future, in scenes whose poses can be used.

    Attributes:
        num_labels: Keyframes, which can be trained and scored on.
        num_starts: Poses, which templates can be fitted to.
        manoeuvres: Keyframes by what the car does next.
    """

    num_labels: int
    num_starts: int
    manoeuvres: dict[str, int]


@dataclass(frozen=True)
class FileFacts:
    """Files that were looked at: of the first, middle and last sample that has one.

    Attributes:
        num_looked_at: How many.
        num_there: How many of them are on disk.
        flaws: What is wrong with those on disk.
    """

    num_looked_at: int
    num_there: int
    flaws: tuple[str, ...]


@dataclass(frozen=True)
class CameraFacts:
    """A camera over all of its images whose calibration can be.

    Attributes:
        channel: Its name.
        num_images: In the tables, of keyframes.
        share: Samples that have one.
        sizes: Images by size, as `1600x900`; `unknown` where the tables have none.
        height_m: Above the ground (z = 0 in `ego`).
        yaw_deg: Direction it looks in, from the ego's x axis, left is positive.
        pitch_deg: Of its optical axis, up is positive.
        roll_deg: About its optical axis; positive: the image's right side is lower on the car.
        field_deg: Horizontal field of view, by intrinsics and width.
        principal_x_px, principal_y_px: Where the optical axis meets the image, in its own pixels.
        files: Some of them.
    """

    channel: str
    num_images: int
    share: float
    sizes: dict[str, int]
    height_m: Spread
    yaw_deg: Spread
    pitch_deg: Spread
    roll_deg: Spread
    field_deg: Spread
    principal_x_px: Spread
    principal_y_px: Spread
    files: FileFacts


@dataclass(frozen=True)
class LidarFacts:
    """The lidar LIDAR_TOP.

    Attributes:
        num_keyframes: Sweeps at keyframes.
        num_sweeps: All of them.
        share: Samples that have one.
        height_m: Of the lidar above the ground (z = 0 in `ego`).
        files: Some of them.
    """

    num_keyframes: int
    num_sweeps: int
    share: float
    height_m: Spread
    files: FileFacts


@dataclass(frozen=True)
class CategoryFacts:
    """A category of annotated boxes.

    Attributes:
        name: As its table has it.
        num_boxes: Annotations.
        is_counted: Whether they are vehicles or people to collide with; None if nobody knows the
            name, which then does not count.
    """

    name: str
    num_boxes: int
    is_counted: bool | None


@dataclass(frozen=True)
class LocationFacts:
    """Where scenes were.

    Attributes:
        name: Of the location.
        num_scenes: There.
        has_map: Whether its map is there.
        on_road: Share of samples at which the car stands on drivable area of the map.
    """

    name: str
    num_scenes: int
    has_map: bool
    on_road: float


@dataclass(frozen=True)
class Finding:
    """Something to mend or to know.

    Attributes:
        level: `error`: it contradicts itself or cannot be; `warning`: it may be meant; `note`: what
            the data set cannot be used for.
        reason: Its kind, one of few.
        where: What has it and how much of it, as `3 of 20 scenes`; may be empty.
        texts: The first few, by file and record.
        num_texts: How many there are.
    """

    level: Level
    reason: str
    where: str
    texts: tuple[str, ...]
    num_texts: int


@dataclass(frozen=True)
class DataReport:
    """Everything, and what is to be said of it.

    Attributes:
        name: Of the data root's folder.
        version: Of its tables.
        boxes: By category; None without usable tables of annotations.
        findings: Errors first, then warnings, then notes.
    """

    name: str
    version: str
    drives: DriveFacts
    motion: MotionFacts
    futures: FutureFacts
    cameras: tuple[CameraFacts, ...]
    lidar: LidarFacts
    boxes: tuple[CategoryFacts, ...] | None
    locations: tuple[LocationFacts, ...]
    findings: tuple[Finding, ...]

    @property
    def num_errors(self) -> int:
        """Findings that are errors."""
        return sum(finding.level == "error" for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """The form of report.json: what does not exist is null."""
        plain: dict[str, Any] = without_nan(asdict(self))
        return plain

    def save(self, path: Path) -> None:
        """Write report.json; it appears whole or not at all.

        Raises:
            OSError: If it cannot be written.
        """
        save_json(self.to_json(), path)
