"""A run's `metrics.csv`: what was logged, one row a step, also over kills and resumptions."""

import csv
import io
from pathlib import Path

from pytorch_lightning.utilities import rank_zero_only

from lss_core.files import write_atomically, write_from
from shoot.training.run_logger import RunLogger

_STEP = "step"
_EPOCH = "epoch"  # Lightning's count of rounds is one too many after a resumption


class MetricsFile(RunLogger):
    """Writes what Lightning logs to one file; what is known of a step stands in one row.

    Lightning's own CSV logger begins anew when a run is resumed. This one keeps the rows before the
    first step it is told of, and drops those a killed run wrote after its last checkpoint.

    Args:
        path: File to write.
        resume: Keep what it holds; else it is forgotten.
    """

    def __init__(self, path: Path, resume: bool) -> None:
        super().__init__(path)
        self.resume = resume
        self._columns = [_STEP]
        self._step: int | None = None
        self._row: dict[str, str] = {}
        self._row_at = 0

    @rank_zero_only
    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        """Add to a step's row; a kill after this returns does not lose it.

        Args:
            metrics: Names and values.
            step: Index of the optimiser step, counted from 0; never less than before.

        Raises:
            OSError: If it cannot be written; the rows of the steps before are as they were.
        """
        step = int(step or 0)
        new = {name: f"{float(value):.9g}" for name, value in metrics.items() if name != _EPOCH}
        if self._step is None:
            before = read_metrics(self.path) if self.resume else {}
            self._rewrite({old: row for old, row in before.items() if old < step}, new)
        elif not new.keys() <= set(self._columns):
            before = read_metrics(self.path)
            self._rewrite({old: row for old, row in before.items() if old < step}, new)
        elif step != self._step:
            self._row_at = self.path.stat().st_size
        self._row = self._row | new if step == self._step else new
        self._step = step
        write_from(self.path, self._row_at, self._line(step, self._row))

    def _rewrite(self, rows: dict[int, dict[str, str]], new: dict[str, str]) -> None:
        """Write all rows but the one at hand, with room for new columns."""
        for row in (*rows.values(), self._row, new):
            self._columns += [name for name in row if name not in self._columns]
        with write_atomically(self.path) as stream:
            stream.write(_csv_line(self._columns))
            for step, row in rows.items():
                stream.write(self._line(step, row))
        self._row_at = self.path.stat().st_size

    def _line(self, step: int, row: dict[str, str]) -> bytes:
        return _csv_line([str(step), *(row.get(name, "") for name in self._columns[1:])])


def read_metrics(path: Path) -> dict[int, dict[str, str]]:
    """Rows of a metrics file by step, empty cells left out; a line cut off by a kill is none.

    A file that is not there has no rows.
    """
    if not path.is_file():
        return {}
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    rows: dict[int, dict[str, str]] = {}
    for row in csv.DictReader(io.StringIO(whole)):
        step = row.pop(_STEP, None)
        if step is not None and step.isdigit():
            rows[int(step)] = {name: value for name, value in row.items() if name and value}
    return rows


def _csv_line(cells: list[str]) -> bytes:
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue().encode()
