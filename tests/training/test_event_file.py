"""What TensorBoard shows of a run: all that was logged, each step once."""

from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from shoot.training.event_file import EventFile


def shown(folder: Path, tag: str) -> list[tuple[int, float]]:
    read = EventAccumulator(str(folder)).Reload()
    return [(event.step, event.value) for event in read.Scalars(tag)]


def test_everything_is_there_at_once(tmp_path: Path) -> None:
    record = EventFile(tmp_path)
    record.log_metrics({"loss": 2.5, "rate": 0.25}, 0)
    record.log_metrics({"loss": 1.5}, 10)
    # Nobody has closed it, as nobody does in a kill.
    assert shown(tmp_path, "loss") == [(0, 2.5), (10, 1.5)]
    assert shown(tmp_path, "rate") == [(0, 0.25)]


def test_what_is_done_again_is_shown_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = EventFile(tmp_path)
    for step in (0, 10, 20):
        record.log_metrics({"loss": 1.0 + step}, step)
    monkeypatch.setattr("time.time", lambda: 4e9)  # files are read in the order of their times
    EventFile(tmp_path).log_metrics({"loss": -1.0}, 10)
    assert shown(tmp_path, "loss") == [(0, 1.0), (10, -1.0)]


def test_nothing_is_made_where_nothing_is_logged(tmp_path: Path) -> None:
    EventFile(tmp_path / "tensorboard")
    assert not (tmp_path / "tensorboard").exists()
