"""What public functions are given and cannot use: said in one sentence, never passed over.

Users have none of the types that tests hold calls to, so that here these are off.
"""

from collections.abc import Callable
from typing import Any

import jaxtyping
import numpy as np
import pytest
import torch
from torch import Tensor

from lss_core.config import DepthBins, ModelConfig
from lss_core.depth_targets import depth_bins
from lss_core.errors import DataError
from lss_core.grid import BevGrid
from lss_core.model import CameraModel, LidarModel
from shoot.metrics.calibration import brier_score
from shoot.metrics.comfort import measure_comfort
from shoot.metrics.displacement import open_loop_l2
from shoot.metrics.manoeuvres import classify_manoeuvres
from shoot.metrics.ranks import (
    LabelRanks,
    PlanningMetrics,
    TemplateErrors,
    min_ade,
    misses,
    negative_log_likelihood,
    rank_labels,
    template_errors,
)
from shoot.planner import Planner, score_templates
from shoot.rendering import render_templates
from shoot.templates import TemplateSet, fit_templates, fit_templates_stream
from shoot.trajectories import futures_from_poses, past_from_poses

NAN = float("nan")
GRID = BevGrid(0.0, 8.0, -4.0, 4.0, 1.0)
MODEL = ModelConfig(
    backbone="plain-4-6-8",
    pretrained="none",
    context_channels=4,
    image_stride=8,
    neck_channels=8,
    stem_channels=8,
    decoder_channels=8,
    depth=DepthBins(4.0, 12.0, 4.0),
    grid=GRID,
)


@pytest.fixture(autouse=True)
def _as_users_call(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


def driven(num: int = 12, dt_s: float = 0.25, num_points: int = 20) -> np.ndarray:
    """[num, T, 2] at 1 m/s ... num m/s, ahead."""
    way_m = np.arange(1.0, num + 1.0)[:, None] * dt_s * np.arange(1, num_points + 1)
    return np.stack([way_m, np.zeros_like(way_m)], axis=-1)


def spoilt(array: np.ndarray, value: float = NAN) -> np.ndarray:
    array = array.copy()
    array.flat[7] = value
    return array


def a_set(points: np.ndarray | None = None, dt_s: float = 0.25, count: int = 1) -> TemplateSet:
    points = driven(3).astype(np.float32) if points is None else points
    return TemplateSet(points, dt_s, np.full(len(points), count, dtype=np.int64))


TEMPLATES = torch.tensor([[[1.5, 0.5], [2.5, 0.5]], [[1.5, -0.5], [2.5, -0.5]]])
TIME_S = np.arange(0.0, 8.0, 0.5)
XY_M = np.stack([5.0 * TIME_S, np.zeros_like(TIME_S)], axis=-1)
YAW_RAD = np.zeros_like(TIME_S)
LOG_PROB = np.log(np.full((2, 3), 1.0 / 3.0))
ERRORS = TemplateErrors(*(np.ones((2, 3)) for _ in range(3)))


def look(images: Tensor, num_cameras: int = 1, mask: Tensor | None = None) -> Tensor:
    torch.manual_seed(0)
    model = CameraModel(MODEL, (16, 32)).eval()
    pixel_from_camera = torch.tensor([[16.0, 0.0, 16.0], [0.0, 16.0, 8.0], [0.0, 0.0, 1.0]])
    ego_from_camera = torch.eye(4)
    ego_from_camera[:3, :3] = torch.tensor([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    output: Tensor = model(
        images,
        pixel_from_camera.expand(1, num_cameras, 3, 3),
        ego_from_camera.expand(1, num_cameras, 4, 4),
        mask,
    )
    return output


def photo(dtype: torch.dtype, scale: float) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return (scale * torch.rand(1, 1, 3, 16, 32, generator=generator)).to(dtype)


DOORS: dict[str, tuple[Callable[[], Any], str]] = {
    "images as whole numbers": (lambda: look(photo(torch.int64, 255.0)), "must be uint8"),
    "float images to 255": (lambda: look(photo(torch.float32, 255.0)), "must lie in 0 to 1"),
    "normalised images": (lambda: look(photo(torch.float32, 4.0) - 2.0), "must lie in 0 to 1"),
    "images of NaN": (lambda: look(photo(torch.float32, NAN)), "must lie in 0 to 1"),
    "other cameras": (lambda: look(photo(torch.uint8, 255.0), 2), "must be"),
    "points of four columns": (
        lambda: LidarModel(MODEL)(torch.zeros(3, 4), torch.zeros(1, dtype=torch.long)),
        "Points must be",
    ),
    "cost map of NaN": (
        lambda: score_templates(torch.full((1, 8, 8), NAN), TEMPLATES, GRID),
        "cost map must be finite",
    ),
    "cost map of other cells": (
        lambda: score_templates(torch.zeros(1, 8, 9), TEMPLATES, GRID),
        "its grid",
    ),
    "templates of NaN": (
        lambda: score_templates(torch.zeros(1, 8, 8), NAN * TEMPLATES, GRID),
        "must be finite",
    ),
    "planner of NaN": (lambda: Planner(NAN * TEMPLATES, GRID), "must be finite"),
    "planner of nothing": (lambda: Planner(TEMPLATES[:0], GRID), "must be"),
    "one depth": (lambda: depth_bins(torch.ones(2), (4.0,)), "two depths"),
    "futures of NaN": (lambda: fit_templates(spoilt(driven()), 3, 0), "1 of 12 are not"),
    "futures of infinity": (lambda: fit_templates(spoilt(driven(), np.inf), 3, 0), "1 of 12"),
    "futures at 2 Hz": (
        lambda: fit_templates(driven(dt_s=0.5, num_points=10), 3, 0),
        "say the time between",
    ),
    "futures in centimetres": (lambda: fit_templates(100.0 * driven(), 3, 0), "slower than 100"),
    "futures of another place": (lambda: fit_templates(driven() + 4e5, 3, 0), "slower than 100"),
    "no time step": (lambda: fit_templates(driven(), 3, 0, dt_s=0.0), "dt_s must be"),
    "fit with a seed below 0": (lambda: fit_templates(driven(), 3, -1), "The seed must lie"),
    "a stream with NaN": (
        lambda: fit_templates_stream(lambda: [driven(), spoilt(driven())], 3, 0),
        "1 of 12 are not",
    ),
    "labels of NaN": (lambda: a_set().nearest(spoilt(driven())), "must be finite"),
    "coverage of NaN": (lambda: a_set().coverage(spoilt(driven())), "must be finite"),
    "labels of others": (lambda: a_set().nearest(driven(num_points=10)), "20 points"),
    "a set of NaN": (lambda: a_set(spoilt(driven()).astype(np.float32)), "must be finite"),
    "a set without time": (lambda: a_set(dt_s=NAN), "dt_s must be"),
    "a set of none": (lambda: a_set(np.zeros((0, 20, 2), dtype=np.float32)), "must be"),
    "a set counted below 0": (lambda: a_set(count=-1), "count each"),
    "places of NaN": (
        lambda: futures_from_poses(TIME_S, spoilt(XY_M), YAW_RAD, TIME_S[:1]),
        "must be finite",
    ),
    "times of NaN": (
        lambda: futures_from_poses(spoilt(TIME_S), XY_M, YAW_RAD, TIME_S[:1]),
        "must be finite",
    ),
    "a heading too few": (
        lambda: futures_from_poses(TIME_S, XY_M, YAW_RAD[1:], TIME_S[:1]),
        r"headings \[P\]",
    ),
    "no step": (
        lambda: futures_from_poses(TIME_S, XY_M, YAW_RAD, TIME_S[:1], dt_s=0.0),
        "dt_s and horizon_s",
    ),
    "a past of times that fall": (
        lambda: past_from_poses(TIME_S[::-1].copy(), XY_M, YAW_RAD, TIME_S[:1]),
        "times must increase",
    ),
    "a label too high": (lambda: rank_labels(LOG_PROB, np.array([0, 3])), r"0\.\.2"),
    "a label below 0": (lambda: negative_log_likelihood(LOG_PROB, np.array([0, -1])), r"0\.\.2"),
    "Brier of no label": (lambda: brier_score(np.exp(LOG_PROB), np.array([0, 3])), r"0\.\.2"),
    "the best 0": (lambda: LabelRanks(np.zeros(2, int), np.ones(2, int)).hits(0), "at least 1"),
    "the best of -1": (lambda: min_ade(ERRORS, -1), "at least 1"),
    "missed by 0": (lambda: misses(ERRORS, 0), "at least 1"),
    "metrics of top 0": (lambda: PlanningMetrics((0, 5)), "at least 1"),
    "errors of no template": (
        lambda: template_errors(driven(3), driven(2), np.array([[0], [3]])),
        r"0\.\.2",
    ),
    "comfort without time": (lambda: measure_comfort(driven(), 0.0), "dt_s must be"),
    "L2 without time": (lambda: open_loop_l2(driven(), driven(), 0.0), "dt_s must be"),
    "manoeuvres of NaN": (lambda: classify_manoeuvres(spoilt(driven())), "must be finite"),
    "a picture of NaN": (
        lambda: render_templates(spoilt(driven(3)), np.ones(3, dtype=int)),
        "must be finite",
    ),
}


@pytest.mark.parametrize("door", DOORS)
def test_what_a_door_cannot_use_is_refused(door: str) -> None:
    call, sentence = DOORS[door]
    with pytest.raises((ValueError, DataError), match=sentence) as refused:
        call()
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300


def test_both_kinds_of_images_say_the_same() -> None:
    whole = photo(torch.uint8, 255.0)
    torch.testing.assert_close(look(whole), look(whole.float() / 255.0))


def test_masked_images_may_hold_anything() -> None:
    images = photo(torch.float32, 1.0).repeat(1, 2, 1, 1, 1)
    images[:, 1] = NAN
    mask = torch.tensor([[True, False]])
    assert look(images, 2, mask).isfinite().all()


def test_a_time_step_that_is_said_is_kept() -> None:
    """At 2 Hz, ten points are 5 s."""
    futures = driven(dt_s=0.5, num_points=10)
    templates = fit_templates(futures, 3, 0, dt_s=0.5)
    assert (templates.dt_s, templates.horizon_s) == (0.5, 5.0)
    streamed, _ = fit_templates_stream(lambda: [futures], 3, 0, dt_s=0.5)
    assert streamed.dt_s == 0.5
