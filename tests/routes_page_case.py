"""Results of routes, made by hand, for the page made of them."""

import io
from typing import Any

import numpy as np
from PIL import Image

from shoot.metrics.driving_score.score import SUB_SCORES
from shoot.report.driving.page import render_driving_page


def make_row(route: int, score: float, **more: Any) -> dict[str, Any]:
    scores = {"driving_score": score, **dict.fromkeys(SUB_SCORES, 1.0), "dac": score}
    facts = {"progress_m": 40.0 + route, "reference_progress_m": 50.0}
    return {"route": route, "town_seed": 100 + route, "seed": 7, "error": None, "scores": scores,
            "facts": facts, "mishaps": [], **more}  # fmt: skip


def make_strip() -> bytes:
    stream = io.BytesIO()
    Image.fromarray(np.zeros((26, 179, 3), np.uint8)).save(stream, "JPEG")
    return stream.getvalue()


def make_summary(driver: str = "run", score: float = 0.5, **more: Any) -> dict[str, Any]:
    def mean(value: float) -> dict[str, float]:
        return {"value": value, "low": value - 0.125, "high": value + 0.125}

    return {
        "driver": driver,
        "mode": "reactive",
        "num_routes": 9,
        "num_towns": 5,
        "driving_score": mean(score),
        "sub_scores": {key: mean(score + 0.01 * i) for i, key in enumerate(SUB_SCORES)},
        "facts": {"red_lights": mean(0.25), "progress_m": mean(40.0)},
        "settings": {"duration_s": 20.0},
        **more,
    }


def hostile_routes_page(word: str) -> str:
    """A page with the same text in every place that text can come from."""
    mishap = {"time_s": 1.0, "what": word, "at_m": [0.0, 0.0]}
    rows = [
        make_row(0, 0.0, error=word),
        make_row(1, 0.5, mishaps=[mishap], town_seed=word, seed=word),
    ]
    minus = {word: make_summary()}
    summary = make_summary(word, mode=word, minus=minus, settings={word: word})
    return render_driving_page(summary, rows, {1: make_strip()}, {word: make_summary()})
