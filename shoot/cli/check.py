"""shoot-check: what is in a data set, and what of it contradicts itself."""

from dataclasses import dataclass
from pathlib import Path

from lss_core.bounds import check_settings
from lss_core.config import CAMERAS, check_cameras
from lss_core.data.samples import load_index
from lss_core.data.tables.file_names import is_plain
from lss_core.errors import DataError
from lss_core.files import write_atomically
from shoot.cli.app import run
from shoot.data_report import DataReport, format_report, survey, view_cameras
from shoot.rendering import render_calibration, save_figure
from shoot.training.planning.config import SMALL


@dataclass(frozen=True)
class CheckedData:
    """Where tables are.

    Attributes:
        root: Folder that holds the version's folder.
        version: Name of the tables' folder.
        cameras: Channels, as in training: both then share one cached index.
    """

    root: str
    version: str = "v1.0-trainval"
    cameras: tuple[str, ...] = CAMERAS

    def __post_init__(self) -> None:
        check_settings(self)
        check_cameras(self.cameras)


@dataclass(frozen=True)
class CheckConfig:
    """Say what was read of a data set, and end with status 2 if that contradicts itself.

    Attributes:
        data: Where tables are.
        out: Folder for the report (report.txt, report.json) and one picture per camera: images with
            the driven path, the horizon, and what the presets give to the network.
    """

    data: CheckedData
    out: str | None = None

    def __post_init__(self) -> None:
        check_settings(self)


def check(config: CheckConfig) -> DataReport:
    """Print the report, and save it with its pictures if asked to.

    Raises:
        DataError: If the data cannot be read; or, when all is said, if there are errors in it.
        OSError: If a file cannot be written.
    """
    root, version = Path(config.data.root), config.data.version
    index = load_index(root, version, config.data.cameras)
    report = survey(index, root, version)
    text = format_report(report)
    print(text)
    if config.out is not None:
        out = Path(config.out)
        with write_atomically(out / "report.txt") as stream:
            stream.write((text + "\n").encode(errors="backslashreplace"))
        report.save(out / "report.json")
        for camera, views in view_cameras(index, root, SMALL.data.image).items():
            if not is_plain(camera):
                raise DataError(
                    f"The channel '{camera}' cannot be the name of a file; rename it in "
                    "sensor.json."
                )
            path = save_figure(render_calibration(views, camera), out / f"{camera}.png")
            print(f"Picture: {path}")
        print(f"Report: {out / 'report.json'}, {out / 'report.txt'}")
    if report.num_errors:
        raise DataError(
            f"The data set '{root / version}' contradicts itself: {report.num_errors} "
            f"{'error' if report.num_errors == 1 else 'errors'} in the findings above; mend the "
            "tables or the files, then check again."
        )
    return report


def main() -> None:
    """Entry point."""
    run(CheckConfig, check, "Say what is in a data set, and what of it contradicts itself.")
