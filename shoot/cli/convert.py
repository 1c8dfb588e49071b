"""shoot-convert: data sets of others as folders in nuScenes format."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias, cast

import tyro

from lss_core.bounds import check_settings
from lss_core.data.converters.argoverse2 import find_argoverse2
from lss_core.data.converters.comma2k19 import find_comma2k19, route_name
from lss_core.data.converters.kitti_odometry import GreyOrColour, find_kitti_odometry
from lss_core.data.converters.kitti_raw import find_kitti_raw
from lss_core.data.converters.scenes import Written, write_drives
from shoot.cli.app import run


@dataclass(frozen=True)
class KittiOdometry:
    """Sequences of KITTI's odometry benchmark: one camera.

    Attributes:
        src: Folder with `sequences/` and `poses/`.
        out: Folder of the data set.
        sequences: Names, as 03; all that have poses if none is named.
        val: Those of them that are for validation; the others are for training.
        camera: 0 is the left grey camera, 2 the left colour camera.
    """

    src: Annotated[Path, tyro.conf.Positional]
    out: Path
    sequences: tuple[str, ...] = ()
    val: tuple[str, ...] = ()
    camera: GreyOrColour = 0

    def __post_init__(self) -> None:
        check_settings(self)

    def write(self) -> Written:
        """Convert."""
        found = find_kitti_odometry(self.src, self.sequences, self.camera)
        return write_drives(found, self.out, self.val)


@dataclass(frozen=True)
class KittiRaw:
    """KITTI's raw recordings, synced and rectified: two colour cameras that look ahead.

    Attributes:
        src: Folder with a folder for each date, which has calibration and drives.
        out: Folder of the data set.
        val: Drives for validation, as 2011_09_26_drive_0001; the others are for training.
        lidar: Write the lidar's sweeps, too.
    """

    src: Annotated[Path, tyro.conf.Positional]
    out: Path
    val: tuple[str, ...] = ()
    lidar: bool = False

    def __post_init__(self) -> None:
        check_settings(self)

    def write(self) -> Written:
        """Convert."""
        return write_drives(find_kitti_raw(self.src, self.lidar), self.out, self.val)


@dataclass(frozen=True)
class Argoverse2:
    """Sensor logs of Argoverse 2: seven cameras around the car, and boxes.

    Attributes:
        src: Folder with `train/`, `val/` and `test/`, whose splits then hold, or with logs.
        out: Folder of the data set.
        val: Logs for validation; the others are for training.
        lidar: Write the lidars' sweeps, too.
    """

    src: Annotated[Path, tyro.conf.Positional]
    out: Path
    val: tuple[str, ...] = ()
    lidar: bool = False

    def __post_init__(self) -> None:
        check_settings(self)

    def write(self) -> Written:
        """Convert."""
        return write_drives(find_argoverse2(self.src, self.lidar), self.out, self.val)


@dataclass(frozen=True)
class Comma2k19:
    """Segments of comma2k19: a camera on the windshield, on the highway.

    Attributes:
        src: Folder with chunks, or with routes.
        out: Folder of the data set.
        val: Routes for validation; the others are for training.
    """

    src: Annotated[Path, tyro.conf.Positional]
    out: Path
    val: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_settings(self)

    def write(self) -> Written:
        """Convert."""
        val = tuple(route_name(name) for name in self.val)
        return write_drives(find_comma2k19(self.src, self.out), self.out, val)


ConvertConfig: TypeAlias = KittiOdometry | KittiRaw | Argoverse2 | Comma2k19
_COMMANDS: Any = (
    Annotated[KittiOdometry, tyro.conf.subcommand("kitti-odometry")]
    | Annotated[KittiRaw, tyro.conf.subcommand("kitti-raw")]
    | Annotated[Argoverse2, tyro.conf.subcommand("argoverse2")]
    | Annotated[Comma2k19, tyro.conf.subcommand("comma2k19")]
)


def convert(config: ConvertConfig) -> Written:
    """Write the data set and say where it is and what its cameras are called.

    Raises:
        DataError: If the source is not as it should be, or the data set is there already.
        OSError: If a file cannot be read or written.
    """
    written = config.write()
    print(f"Wrote {written.folder}; its cameras are --data.cameras {' '.join(written.cameras)}")
    return written


def main() -> None:
    """Entry point."""
    commands = cast(Callable[..., ConvertConfig], _COMMANDS)
    run(commands, convert, "Write a data set of others as a folder in nuScenes format.")
