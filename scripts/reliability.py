"""Throws everything at the code that tests/faults has, and writes the table of docs/reliability.md.

    python scripts/reliability.py [--short] [--page docs/reliability.md]

An hour or two in full. Exits 0 only if nothing was lost; the page is written either way.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from marked_page import fill_page

Row = dict[str, Any]


@dataclass(frozen=True)
class ReliabilityConfig:
    """What to throw, and where to write.

    Attributes:
        short: The short form of each fault, as in the everyday tests; the page is not written.
        page: Page whose table is made anew.
        workers: Processes that test side by side.
    """

    short: bool = False
    page: Path = Path("docs/reliability.md")
    workers: int = 2


def throw_all(config: ReliabilityConfig) -> int:
    """Run the tests, print the table and write it down; returns the tests' exit status."""
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally = Path(folder) / "tally.jsonl"
        marks = "not full" if config.short else "full or not full"
        tests = ["-m", "pytest", "tests/faults", "-m", marks, "-n", str(config.workers)]
        environment = {**os.environ, "SHOOT_TALLY": str(tally), "OMP_NUM_THREADS": "1"}
        status = subprocess.run([sys.executable, *tests], env=environment, check=False).returncode
        lines = tally.read_text(encoding="utf-8").splitlines() if tally.exists() else []
    rows = [json.loads(line) for line in lines]
    text = f"{_setting(rows, time.monotonic() - started_s)}\n\n{table(rows)}"
    print(text)
    if not config.short:
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


def _setting(rows: list[Row], seconds: float) -> str:
    times, lost = (sum(row[name] for row in rows) for name in ("times", "lost"))
    return (
        f"{times:,} times in all, {lost:,} lost. One call of `python scripts/reliability.py`, "
        f"{seconds / 60.0:.0f} minutes on {len(os.sched_getaffinity(0))} cores."
    )


if __name__ == "__main__":
    sys.exit(throw_all(tyro.cli(ReliabilityConfig, description=__doc__)))
