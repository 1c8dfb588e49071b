"""A run's file for TensorBoard: what was logged, also over kills, resumptions and full disks."""

import io
import os
import socket
import time
from pathlib import Path

from pytorch_lightning.utilities import rank_zero_only
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

from lss_core.files import write_atomically, write_from
from shoot.training.run_logger import RunLogger

_FORMAT = "brain.Event:2"


class EventFile(RunLogger):
    """Writes what Lightning logs for TensorBoard; a kill loses nothing that was logged before it.

    TensorBoard's own writer leaves it to a thread, which keeps it for two minutes: a killed run
    would go on after events that are lost. When a disk is full, that thread prints a traceback.

    Args:
        folder: Gets one file for each start of the run.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._file: Path | None = None

    @rank_zero_only
    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        """Add scalars.

        Args:
            metrics: Names and values.
            step: Index of the optimiser step, counted from 0.

        Raises:
            OSError: If they cannot be written; what was there before is as it was.
        """
        step = int(step or 0)
        if self._file is None:
            self._file = self._begin(step)
        values = [Summary.Value(tag=tag, simple_value=float(v)) for tag, v in metrics.items()]
        events = [Event(step=step, summary=Summary(value=[value])) for value in values]
        write_from(self._file, self._file.stat().st_size, _records(events))

    def _begin(self, step: int) -> Path:
        """Make a file; TensorBoard then forgets what a killed run logged of this step and later."""
        now = f"{time.time():.0f}.{socket.gethostname()}.{os.getpid()}"
        path = self.path / f"events.out.tfevents.{now}"
        start = SessionLog(status=SessionLog.START)
        with write_atomically(path) as stream:
            events = [Event(file_version=_FORMAT), Event(step=step, session_log=start)]
            stream.write(_records(events))
        return path


def _records(events: list[Event]) -> bytes:
    """Events as they stand in a file, with the time of day."""
    whole = io.BytesIO()
    for event in events:
        event.wall_time = time.time()
        RecordWriter(whole).write(event.SerializeToString())
    return whole.getvalue()
