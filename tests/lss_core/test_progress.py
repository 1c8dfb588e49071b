"""Long work says how far it is: on a terminal by a bar, in a log by lines."""

import io
import logging
import re
from pathlib import Path

import pytest
import rich
from rich.console import Console
from world_fixture import TinyRun, command, train_flags

from lss_core import progress as module
from lss_core.progress import progress
from shoot.training import callbacks


def test_a_log_gets_lines_with_what_was_done_before(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SAY_EVERY_S", 0.0)
    with caplog.at_level(logging.INFO), progress("Scenes", total=10, done=4) as advance:
        advance(2)
        advance(4)
    assert caplog.messages == ["Scenes: 6 of 10", "Scenes: 10 of 10"]


def test_quick_work_leaves_a_log_as_it_is(
    caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    with caplog.at_level(logging.INFO), progress("Scenes", total=2) as advance:
        advance(2)
    assert not caplog.messages
    assert not capsys.readouterr().out.strip()


def test_a_terminal_gets_a_bar_and_no_lines(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = Console(file=io.StringIO(), force_terminal=True, width=80)
    monkeypatch.setattr(rich, "_console", terminal)
    monkeypatch.setattr(module, "SAY_EVERY_S", 0.0)
    with caplog.at_level(logging.INFO), progress("Scenes", total=10, done=4) as advance:
        advance(6)
    assert "10/10" in terminal.file.getvalue()  # type: ignore[attr-defined]
    assert not caplog.messages


def test_a_training_tells_a_log_of_loss_and_validations(
    tiny_run: TinyRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(callbacks, "SAY_EVERY_S", 0.0)
    flags = train_flags(tiny_run.root, tiny_run.templates, tmp_path / "run", 4, 2)
    said = command("shoot-train", *flags)
    assert said.status == 0, said.err
    text = " ".join(said.out.split())  # lines are broken to the width of the output
    assert re.findall(r"Step (\d) of 4: loss \d", text) == ["1", "2", "3", "4"]
    found = re.findall(r"Step (\d) of 4: validation top-10 [\d.]+ %, NLL [\d.]+ nats", text)
    assert found == ["2", "4"]
