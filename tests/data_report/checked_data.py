"""What shoot-check says of a data set, and what it found."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from world_fixture import Said, command

SCENES = 3
Row = dict[str, Any]


def check(root: Path, *more: object) -> Said:
    return command("shoot-check", "--data.root", root, *more)


def refuse(constant: str) -> float:
    raise AssertionError(f"{constant} is no JSON")


def report_of(
    root: Path,
    out: Path,
    *more: object,
    status: int = 0,
    cameras: Sequence[str] = ("CAM_FRONT",),
) -> dict[str, Any]:
    """The saved report; the printed one is the same as report.txt."""
    said = check(root, "--out", out, "--data.cameras", *cameras, *more)
    assert said.status == status, said.out + said.err
    assert "Traceback" not in said.out + said.err
    assert (out / "report.txt").read_text().strip() in said.out
    loaded: dict[str, Any] = json.loads((out / "report.json").read_text(), parse_constant=refuse)
    return loaded


def findings(report: dict[str, Any]) -> list[tuple[str, str]]:
    return [(one["level"], one["reason"]) for one in report["findings"]]


def bad(report: dict[str, Any]) -> list[tuple[str, str]]:
    return [one for one in findings(report) if one[0] != "note"]
