"""The trained planner beside its baselines on one split, from checkpoint to report."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from lss_core.config import DataConfig
from shoot.baselines import (
    constant_velocity_futures,
    fit_blind,
    fit_prior,
    fit_sigma,
    future_log_prob,
)
from shoot.datamodule import LabelledSplit, load_split
from shoot.evaluation import Report, condition_of, evaluate
from shoot.planner import Planner
from shoot.prediction import TrainedRun, predict
from shoot.templates import TemplateSet


def compare(run: TrainedRun, split: str, show_progress: bool = True, fast: bool = False) -> Report:
    """Score a run and its baselines on the same samples.

    The baselines are fitted on the run's training labels, never on `split`.

    Args:
        run: Trained planner.
        split: Scenes to score on.
        show_progress: Show how far prediction is.
        fast: Predict by `FastPlanner`.

    Raises:
        DataError: If data is not as it should be.
    """
    samples = load_split(run.config.data, split, run.templates)
    known = _training_labels(run)
    log_probs: dict[str, NDArray[Any]] = {"model": predict(run, samples, show_progress, fast)}
    log_probs |= baseline_log_probs(known, samples, run.templates, run.module.planner)
    descriptions = samples.index.scene_description[samples.futures.scene]
    return evaluate(
        log_probs,
        samples.labels,
        samples.futures.xy_m,
        run.templates.points,
        samples.futures.scene,
        [condition_of(str(text)) for text in descriptions],
        split,
        np.linalg.norm(samples.futures.velocity_mps, axis=-1),
    )


def baseline_log_probs(
    train: LabelledSplit, split: LabelledSplit, templates: TemplateSet, planner: Planner
) -> dict[str, NDArray[np.float64]]:
    """Log-probabilities of what any planner must beat.

    Args:
        train: What they are fitted on.
        split: What they are asked about.
        templates: Both are labelled with.
        planner: Grid and rules of reading for the blind planner.

    Returns:
        `prior` and `blind` [K], the same for all samples; `constant_velocity` [S, K], which
        knows the speed.
    """
    points = templates.points
    driving_on = constant_velocity_futures(train.futures.velocity_mps)
    sigma_m = fit_sigma(driving_on, points, train.labels)
    blind_planner = Planner(torch.from_numpy(points), planner.grid, planner.config)
    return {
        "prior": fit_prior(train.labels, train.futures.scene, len(points)),
        "blind": fit_blind(blind_planner, train.labels, train.futures.scene).log_prob,
        "constant_velocity": future_log_prob(
            constant_velocity_futures(split.futures.velocity_mps), points, sigma_m
        ),
    }


def _training_labels(run: TrainedRun) -> LabelledSplit:
    data: DataConfig = run.config.data
    return load_split(data, run.config.train_split, run.templates, need_files=False)
