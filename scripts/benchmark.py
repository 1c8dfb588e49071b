"""Times what users get against straightforward code, in turn, and says whether all ratios hold.

    python scripts/benchmark.py [--rows splat plan export step loader index fit drive] [--growth]
    python scripts/benchmark.py --device cuda [--rows splat plan step]

Exit status 0 only if every ratio and every check holds, 2 if there is no such device. Results of an
earlier call in the same folder (worlds, runs, tables) are used again.
"""

import json
import logging
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import torch
import tyro
from benchmarks import gpu
from benchmarks.growth import LARGEST_EXPONENT, Growth, all_growth
from benchmarks.growth_figure import draw_growth
from benchmarks.machine import Machine, measure
from benchmarks.row import Row, Setting
from benchmarks.rows import ROWS

from lss_core.bounds import Count, check_settings
from lss_core.errors import DataError
from lss_core.files import write_atomically


@dataclass(frozen=True)
class BenchmarkConfig:
    """Time the fast ways against the plain ones.

    Attributes:
        rows: Groups of rows.
        device: `cuda`: the table of a GPU instead, of those groups that have one.
        folder: Where worlds, runs and tables for it are made.
        repeats: How often each pair is timed.
        images: Data root with 1600 x 900 images to load; a synthetic scene's if not given.
        images_version: Its version.
        out: JSON to write; `benchmark.json` in the folder if not given.
        growth: Measure how time and memory grow, too, and draw it.
        growth_figure: Picture of it to write; `growth.png` in the folder if not given.
    """

    rows: tuple[str, ...] = tuple(ROWS)
    device: Literal["cpu", "cuda"] = "cpu"
    folder: Path = Path("runs/benchmark")
    repeats: Count = 7
    images: Path | None = None
    images_version: str = "v1.0-mini"
    out: Path | None = None
    growth: bool = False
    growth_figure: Path | None = None

    def __post_init__(self) -> None:
        check_settings(self)


def benchmark(config: BenchmarkConfig) -> bool:
    """Run the rows, print the table, write the JSON; True if everything holds.

    Raises:
        DataError: If there is no GPU, and one was asked for.
    """
    if config.device == "cuda":
        return benchmark_gpu(config)
    config.folder.mkdir(parents=True, exist_ok=True)
    machine = measure()
    setting = Setting(config.folder, machine, config.repeats, config.images, config.images_version)
    rows = run_rows({name: partial(ROWS[name], setting) for name in config.rows})
    growths = list(all_growth(config.folder)) if config.growth else []
    if growths:
        draw_growth(growths, config.growth_figure or config.folder / "growth.png")
    print(format_machine(machine))
    print(format_table(rows))
    print(format_growth(growths))
    found = {
        "machine": asdict(machine),
        "rows": [asdict(row) | {"holds": row.holds} for row in rows],
        "growth": [
            asdict(growth)
            | {"exponent": growth.exponent, "memory_exponent": growth.memory_exponent}
            for growth in growths
        ],
    }
    with write_atomically(config.out or config.folder / "benchmark.json") as stream:
        stream.write((json.dumps(found, indent=1) + "\n").encode())
    return all(row.holds for row in rows) and all(growth.holds for growth in growths)


def benchmark_gpu(config: BenchmarkConfig) -> bool:
    """The same on a GPU.

    Raises:
        DataError: If there is none.
    """
    if not torch.cuda.is_available():
        raise DataError("Torch finds no CUDA GPU here; leave out --device cuda to time the CPU.")
    config.folder.mkdir(parents=True, exist_ok=True)
    groups = gpu.gpu_rows(gpu.Work("cuda", repeats=config.repeats))
    rows = run_rows({name: groups[name] for name in config.rows if name in groups})
    print(gpu.card())
    print(format_table(rows))
    found = {"card": gpu.card(), "rows": [asdict(row) | {"holds": row.holds} for row in rows]}
    with write_atomically(config.out or config.folder / "benchmark-cuda.json") as stream:
        stream.write((json.dumps(found, indent=1) + "\n").encode())
    return all(row.holds for row in rows)


def run_rows(groups: dict[str, Callable[[], Iterator[Row]]]) -> list[Row]:
    """Their rows, one after the other; how they went, on standard error."""
    rows: list[Row] = []
    for name, group in groups.items():
        started = time.monotonic()
        for row in group():
            rows.append(row)
            print(f"{row.name}: {row.pair.ratio.median:.1f} times", file=sys.stderr)
        print(f"{name}: {time.monotonic() - started:.0f} s", file=sys.stderr)
    return rows


def format_machine(machine: Machine) -> str:
    """Its name and limits, a line."""
    return (
        f"{machine.cores} cores of {machine.name}; {machine.versions}; float32 "
        f"{machine.float32_flops / 1e12:.2f} and bfloat16 {machine.bfloat16_flops / 1e12:.2f} "
        f"TFLOP/s in matrix products, {machine.copied_bytes_s / 1e9:.1f} GB/s copied\n"
    )


def format_table(rows: list[Row]) -> str:
    """The table in Markdown, and what was checked below it."""
    lines = [
        "| what | plain, s | fast, s | ratio | needed | plain, MB | fast, MB | floor, s | |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        pair = row.pair
        plain, fast = (_time(s.median, s.low, s.high) for s in (pair.plain_s, pair.fast_s))
        ratio = f"**{pair.ratio.median:.1f}** [{pair.ratio.low:.1f}, {pair.ratio.high:.1f}]"
        floor = (
            f"{row.floor_s:.2g} ({100 * row.floor_s / pair.fast_s.median:.0f} %)"
            if row.floor_s
            else "-"
        )
        verdict = "holds" if row.holds else "FAILS"
        lines.append(
            f"| {row.name} | {plain} | {fast} | {ratio} | {row.required:g} | {pair.plain_mb:.0f} | "
            f"{pair.fast_mb:.0f} | {floor} | {verdict} |"
        )
    lines.append("")
    for row in rows:
        lines.append(f"- {row.name}: {row.plain} against {row.fast}.")
        lines += [f"  - {check.what}{'' if check.holds else ': FAILS'}" for check in row.checks]
    return "\n".join(lines)


def format_growth(growths: list[Growth]) -> str:
    """Times, memory and exponents in Markdown; empty if there is nothing to show."""
    lines = []
    for growth in growths:
        verdict = "holds" if growth.holds else "FAILS"
        lines += [
            f"\n{growth.what}, by {growth.of}: exponent of time {growth.exponent:.2f}, of memory "
            f"{growth.memory_exponent:.2f} (at most {LARGEST_EXPONENT}): {verdict}\n",
            "| " + " | ".join([growth.of, *(f"{size:,.0f}" for size in growth.sizes)]) + " |",
            "| --- " * (len(growth.sizes) + 1) + "|",
            "| " + " | ".join(["time, s", *(f"{s:.3g}" for s in growth.seconds)]) + " |",
            "| " + " | ".join(["memory, MB", *(f"{mb:,.0f}" for mb in growth.mb)]) + " |",
        ]
    return "\n".join(lines)


def _time(median: float, low: float, high: float) -> str:
    return f"{median:.3g} [{low:.3g}, {high:.3g}]"


if __name__ == "__main__":
    logging.basicConfig(level=logging.WARNING)
    try:
        sys.exit(0 if benchmark(tyro.cli(BenchmarkConfig, description=__doc__)) else 1)
    except DataError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
