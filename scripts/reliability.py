"""Throws everything at the code that there is, and writes the table of docs/reliability.md.

    python scripts/reliability.py [--only test_kills] [--tally FILE] [--page FILE]

An hour in full. What was thrown is kept in the tally, to which further calls add: so it can be done
in parts. The page is made from the whole tally. Exits 0 only if nothing was lost.
"""

import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from marked_page import fill_page

from lss_core.bounds import Workers, check_settings

Row = dict[str, Any]


@dataclass(frozen=True)
class ReliabilityConfig:
    """What to throw, and where to write.

    Attributes:
        only: Tests to run, as for `pytest -k`; all if not given.
        tally: What was thrown so far; remove it to begin anew.
        page: Page whose table is made.
        workers: Processes that test side by side.
    """

    only: str | None = None
    tally: Path = Path("runs/faults.jsonl")
    page: Path = Path("docs/reliability.md")
    workers: Workers = 2

    def __post_init__(self) -> None:
        check_settings(self)


def throw_all(config: ReliabilityConfig) -> int:
    """Run the tests and make the page; returns the tests' exit status."""
    tally = config.tally.absolute()
    tally.parent.mkdir(parents=True, exist_ok=True)
    tests = ["-m", "pytest", "-m", "faults or full", "-n", str(config.workers)]
    environment = {**os.environ, "SHOOT_TALLY": str(tally), "OMP_NUM_THREADS": "1"}
    started_s = time.monotonic()
    status = subprocess.run(
        [sys.executable, *tests, "-k", config.only or ""], env=environment, check=False
    ).returncode
    with tally.open("a", encoding="utf-8") as stream:
        call = {"seconds": time.monotonic() - started_s, "cores": len(os.sched_getaffinity(0))}
        stream.write(json.dumps(call) + "\n")
    lines = [json.loads(line) for line in tally.read_text(encoding="utf-8").splitlines()]
    rows = [line for line in lines if "what" in line]
    text = f"{_setting(rows, [line for line in lines if 'seconds' in line])}\n\n{table(rows)}"
    print(text)
    fill_page(config.page, "faults", text)
    return status


def table(rows: list[Row]) -> str:
    """What was thrown, how often, what must be seen, what was lost; one line each."""
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[row["what"], row["outcome"]].append(row)
    lines = ["| thrown | times | what must be seen | lost | |", "| --- | --- | --- | --- | --- |"]
    for (what, outcome), own in sorted(groups.items()):
        times, lost = (sum(row[name] for row in own) for name in ("times", "lost"))
        figures = {name: text for row in own for name, text in row["figures"].items()}
        shown = "; ".join(f"{name} {text}" for name, text in figures.items())
        lines.append(f"| {what} | {times:,} | {outcome} | {lost:,} | {shown} |")
    return "\n".join(lines)


def _setting(rows: list[Row], calls: list[Row]) -> str:
    times, lost = (sum(row[name] for row in rows) for name in ("times", "lost"))
    minutes = sum(call["seconds"] for call in calls) / 60.0
    return (
        f"{times:,} times in all, {lost:,} lost. Calls of `python scripts/reliability.py`: "
        f"{len(calls)}, together {minutes:.0f} minutes on {calls[-1]['cores']} cores."
    )


if __name__ == "__main__":
    sys.exit(throw_all(tyro.cli(ReliabilityConfig, description=__doc__)))
