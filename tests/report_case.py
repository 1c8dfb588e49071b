"""Made-up scores of two methods on 240 samples, for reports, and a check of paths."""

from typing import Any

import numpy as np
from scipy.special import log_softmax

from shoot.evaluation.report import evaluate
from shoot.evaluation.results import Report
from shoot.metrics.ranks import TOP_KS

COMFORT = ["lon_accel_mps2", "lat_accel_mps2", "jerk_mps3", "comfort"]
CHECKS = [f"{what}_{s}s" for what in ("collision", "off_road") for s in (1, 2, 3, 5)]
METRICS = (
    [f"top{k}" for k in TOP_KS]
    + ["nll", "brier", "expected_ade"]
    + [f"{name}_{k}" for name in ("min_ade", "min_fde", "miss_rate") for k in TOP_KS]
    + [f"l2_{how}_{s}s" for how in ("at", "upto") for s in (1, 2, 3)]
    + COMFORT
)


def make_case() -> dict[str, Any]:
    """240 samples of 12 scenes: standing and straight, day and rain."""
    generator = np.random.default_rng(0)
    time_s = 0.25 * np.arange(1, 21)
    speeds = np.linspace(0.0, 12.0, 30)
    line = np.stack([time_s, 0.0 * time_s], axis=-1)
    templates = (speeds[:, None, None] * line).astype(np.float32)
    labels = np.where(generator.random(240) < 0.3, 0, generator.integers(1, 30, 240))
    futures = templates[labels] + generator.normal(0.0, 0.02, (240, 20, 2)).astype(np.float32)
    logits = generator.normal(size=(240, 30))
    logits[np.arange(240), labels] += 2.0
    scene_idx = np.repeat(np.arange(12), 20) + 50
    return {
        "log_probs": {
            "model": log_softmax(logits, axis=1).astype(np.float32),
            "prior": log_softmax(generator.normal(size=30)),
        },
        "labels": labels,
        "futures": futures,
        "templates": templates,
        "scene_idx": scene_idx,
        "conditions": ["day" if scene < 58 else "rain" for scene in scene_idx],
        "split": "val",
        "speed_mps": speeds[labels] + generator.uniform(0.0, 0.5, 240),
    }


def check_against_wall(paths: np.ndarray[Any, np.dtype[Any]]) -> dict[str, Any]:
    """A wall across the road at x = 20 m; the first 20 samples are not checked."""
    found = {}
    for seconds in (1, 2, 3, 5):
        hit = 100.0 * (paths[:, : 4 * seconds, 0].max(axis=1) > 20.0)
        hit[:20] = np.nan
        found |= {f"collision_{seconds}s": hit, f"off_road_{seconds}s": 0.0 * hit}
    return found


def evaluate_scene(case: dict[str, Any], scene: int) -> Report:
    """The report of one of its scenes by itself."""
    keep = case["scene_idx"] == scene
    log_probs = {"model": case["log_probs"]["model"][keep]}
    arrays = {
        name: case[name][keep] for name in ("labels", "futures", "scene_idx", "speed_mps")
    } | {"conditions": ["day"] * int(keep.sum())}
    return evaluate(**case | arrays | {"log_probs": log_probs}, path_checks=check_against_wall)
