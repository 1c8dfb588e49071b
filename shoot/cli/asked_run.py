"""What commands that ask a trained run share: of which data, and how it is opened."""

from collections.abc import Mapping
from dataclasses import dataclass

from lss_core.bounds import check_settings
from lss_core.config import check_cameras
from lss_core.errors import DataError
from lss_core.legible import legible
from shoot.prediction.run import TrainedRun, open_run
from shoot.prediction.segmenter import TrainedSegmenter, open_segmenter


@dataclass(frozen=True)
class OtherData:
    """Data other than what the run was trained on.

    Attributes:
        root: Data root; the run's own if not given.
        version: Version of the tables; the run's own if not given.
        cameras: Channels that the planner is to see, any number of them; the run's own if not
            given.
        skip_bad: Leave out samples whose files are absent or damaged, or whose calibration or poses
            cannot be, count and list them.
    """

    root: str | None = None
    version: str | None = None
    cameras: tuple[str, ...] | None = None
    skip_bad: bool = False

    def __post_init__(self) -> None:
        check_settings(self)
        if self.cameras is not None:
            check_cameras(self.cameras)

    def open_run(self, run: str, checkpoint: str, templates: str | None = None) -> TrainedRun:
        """A planner that reads this data; see `shoot.prediction.run.open_run`.

        Raises:
            DataError: If something is missing or does not fit together.
        """
        return open_run(
            run, checkpoint, self.root, self.version, templates, self.skip_bad, self.cameras
        )

    def open_segmenter(self, run: str, checkpoint: str) -> TrainedSegmenter:
        """A segmentation that reads this data; see `shoot.prediction.segmenter.open_segmenter`.

        Raises:
            DataError: If something is missing or does not fit together.
        """
        return open_segmenter(run, checkpoint, self.root, self.version, self.skip_bad, self.cameras)


def refuse_settings(given: Mapping[str, object], run: str) -> None:
    """Check that nothing is asked of a segmentation that only planners can do.

    Args:
        given: Flag -> what it was set to, if anything.
        run: Run folder, for the message.

    Raises:
        DataError: If something is.
    """
    flags = [flag for flag, value in given.items() if value]
    if flags:
        raise DataError(
            f"'{legible(run)}' is a segmentation, and {' and '.join(flags)} can be asked of a "
            "planner only; leave it out."
        )
