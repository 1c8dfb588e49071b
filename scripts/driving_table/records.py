"""What a driven study leaves behind: one small JSON a drive, from which every table is made."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from run_queue import Record, read_json

from driving_table.drives import Drive
from driving_table.failings import failings_of, speed_jumps_mps
from lss_core.geometry import FloatArray
from shoot.metrics.driving_score.score import SUB_SCORES
from shoot.simulation.route_log import Mode
from shoot.simulation.routes.result_files import SETTINGS, SUMMARY, Row, read_object
from shoot.templates import TemplateSet

SCORES = ("driving_score", *SUB_SCORES)
JUMP = "speed_jump_mps"


def record_of(
    drive: Drive,
    mode: Mode,
    folder: Path,
    rows: Sequence[Row],
    templates: TemplateSet | None,
    report: Mapping[str, Any] | None,
) -> Record:
    """What is worth keeping of a drive.

    Args:
        drive: Who drove.
        mode: With which traffic.
        folder: Of the results, with their summary.
        rows: Results of all routes.
        templates: Of its run, if it has one.
        report: Of shoot-evaluate, on the run that drives: what open loop says of it.
    """
    summary = read_object(folder / SUMMARY)
    whole = [row for row in rows if row["error"] is None]
    jumps = {row["route"]: speed_jumps_mps(row, templates) for row in whole}
    failings = {row["route"]: failings_of(row, jumps[row["route"]]) for row in whole}
    return {
        "name": f"{drive.name}-{mode}",
        "who": drive.who,
        "run": None if drive.run is None else drive.run.name,
        "mode": mode,
        "settings": read_json(folder / SETTINGS),
        "failures": summary["failures"],
        "means": {
            "bench2drive": summary["bench2drive"]["score"],
            "success": summary["bench2drive"]["success"],
            "strict_route": summary["strict_route"]["driving_score"],
            **summary["facts"],
        },
        "towns": [row["town"] for row in rows],
        "scores": {name: [_short(row["scores"][name]) for row in rows] for name in SCORES},
        "bench2drive": [_short(row["bench2drive"]["score"]) for row in rows],
        JUMP: [_mean(jumps.get(row["route"], np.empty(0))) for row in rows],
        "failings": {
            name: [_short(failings.get(row["route"], {}).get(name)) for row in rows]
            for name in next(iter(failings.values()), {})
        },
        "open_loop": (
            {name: _short(mean["value"]) for name, mean in report["methods"]["model"].items()}
            if report is not None
            else None
        ),
    }


def _mean(values: FloatArray) -> float | None:
    return _short(float(values.mean())) if len(values) else None


def _short(value: float | None) -> float | None:
    """Four digits; what is no number is null."""
    if value is None or math.isnan(value):
        return None
    return float(f"{value:.4g}")
