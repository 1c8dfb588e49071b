"""The trained planner beside its baselines on one split, from checkpoint to report."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray

from lss_core.data.drives import KnownScene
from lss_core.legible import legible
from shoot.baselines import (
    PastMotionFit,
    along_heading,
    constant_velocity_futures,
    constant_yaw_rate_futures,
    driving_on_log_prob,
    fit_blind,
    fit_prior,
    fit_speed_prior,
    kept_past_motion,
    standing_still_log_prob,
)
from shoot.evaluation.driving_checks import DrivingChecks
from shoot.evaluation.known_speed import tell_speed
from shoot.evaluation.report import condition_of, evaluate
from shoot.evaluation.results import KNOWING_SPEED, MODEL, Report
from shoot.metrics.ranks import negative_log_likelihood, rank_labels
from shoot.planner import Planner
from shoot.prediction.run import TrainedRun, predict
from shoot.templates import TemplateSet
from shoot.training.planning.data import LabelledSplit, load_split
from shoot.training.planning.motion import TrainingMotion
from shoot.training.run_scenes import RunScenes, count_seen
from shoot.trajectories import Futures

Array = np.ndarray[Any, np.dtype[Any]]

logger = logging.getLogger(__name__)

# From pasts, horizon and step to paths.
_DrivingOn = Callable[[Futures, float, float], Array]


@dataclass(frozen=True)
class Scored:
    """What every method says of the same samples.

    Attributes:
        samples: What was asked about.
        log_probs: Method -> log-probabilities of the templates in nats, [S, K], or [K] if they are
            the same for all samples.
        checks: Of paths from these samples, against annotations and maps.
        num_seen_scenes: Of their scenes those that the run was trained on, or its templates fitted.
    """

    samples: LabelledSplit
    log_probs: dict[str, Float[Array, "..."]]
    checks: DrivingChecks
    num_seen_scenes: int = 0


def compare(run: TrainedRun, split: str, fast: bool = False) -> Report:
    """Score a run and its baselines on the same samples, and sum it up; see `score`.

    Raises:
        DataError: If data is not as it should be, or the run has seen it.
    """
    return sum_up(run, score(run, split, fast), split)


def sum_up(run: TrainedRun, scored: Scored, split: str) -> Report:
    """The report of what every method says of a split.

    Args:
        run: Whose data and templates.
        scored: Of the split.
        split: Its name.
    """
    samples, checks = scored.samples, scored.checks
    descriptions = samples.index.scene_description[samples.futures.scene]
    report = evaluate(
        scored.log_probs,
        samples.labels,
        samples.futures.xy_m,
        run.templates.points,
        samples.futures.scene,
        [condition_of(str(text)) for text in descriptions],
        split,
        np.where(_is_known(samples.futures), _speed_mps(samples.futures), np.nan),
        checks,
        samples.logs,
        run.templates.dt_s,
    )
    return replace(
        report,
        num_boxes_left_out=checks.num_boxes_left_out,
        num_samples_with_boxes_left_out=checks.num_samples_affected,
        by_scene=means_by_scene(samples, scored.log_probs[MODEL]),
        num_bad_samples=len(samples.left_out),
        num_seen_scenes=scored.num_seen_scenes,
        rests_on=checks.basis,
    )


def means_by_scene(
    samples: LabelledSplit, log_prob: Float[Array, "N K"]
) -> dict[str, dict[str, float | int | str]]:
    """What two reports are compared by: `by_scene` of a planner's report.

    Args:
        samples: N samples.
        log_prob: What a planner says of K templates.
    """
    hit = 100.0 * rank_labels(log_prob, samples.labels).hits(10)
    nll = negative_log_likelihood(log_prob, samples.labels)
    logs, found = samples.logs, dict[str, dict[str, float | int | str]]()
    for name in np.unique(samples.scene_names):
        own = samples.scene_names == name
        found[str(name)] = {
            "num_samples": int(own.sum()),
            "top10": float(hit[own].mean()),
            "nll": float(nll[own].mean()),
        } | ({} if logs is None else {"log": str(logs[own][0])})
    return found


def score(
    run: TrainedRun, split: str, fast: bool = False, allow_seen_scenes: bool = False
) -> Scored:
    """What a run and its baselines say of the samples of a split.

    The baselines are fitted on the run's training labels, which it keeps: whatever data is scored,
    they know what the run could know.

    Args:
        run: Trained planner.
        split: Scenes to score on.
        fast: Predict by `FastPlanner`.
        allow_seen_scenes: Score also scenes that the run was trained on, or its templates fitted.

    Returns:
        `model`, the methods of `baseline_log_probs`, and `model_knowing_speed`: what the model
        would say if it were told the speed, see `tell_speed`. That is no baseline: it shows what
        the speed, which cameras alone do not tell, would add.

    Raises:
        DataError: If data is not as it should be, or the run has seen it.
    """
    samples = load_split(run.config.data, split, run.templates)
    known = TrainingMotion.load(run.folder.motion_file, run.templates)
    num_seen_scenes = _count_seen(run, known, samples.scenes, allow_seen_scenes)
    # All that is asked of the data is asked before what takes long.
    checks = DrivingChecks(samples, run.config.data)
    model = predict(run, samples, fast)
    log_probs: dict[str, Array] = {MODEL: model}
    past_motion = kept_past_motion(
        run.folder.past_motion_file, known.past, known.labels, run.templates.points
    )
    log_probs |= baseline_log_probs(known, samples, run.templates, run.module.planner, past_motion)
    log_probs[KNOWING_SPEED] = tell_speed(model, log_probs["speed_prior"], log_probs["prior"])
    return Scored(samples, log_probs, checks, num_seen_scenes)


def _count_seen(
    run: TrainedRun, known: TrainingMotion, scored: tuple[KnownScene, ...], allow: bool
) -> int:
    """How many scenes the run has seen, if it is allowed.

    Raises:
        DataError: If it has, and it is not.
    """
    kept = RunScenes.load(run.folder.scenes_file)
    if kept is None:
        logger.warning(
            "'%s' has no %s: whether it was trained on these scenes is seen by their tokens only.",
            legible(str(run.folder.folder)),
            run.folder.scenes_file.name,
        )
        tokens = known.scene_token.tolist()
        kept = RunScenes(tuple(KnownScene("", token) for token in tokens), (), ())
    return count_seen(scored, kept.trained, (*kept.fitted, *run.templates.scenes), allow)


def baseline_log_probs(
    train: TrainingMotion,
    split: LabelledSplit,
    templates: TemplateSet,
    planner: Planner,
    past_motion: PastMotionFit,
) -> dict[str, Array]:
    """Log-probabilities of what any planner must beat.

    Args:
        train: What they are fitted on.
        split: What they are asked about; of its futures only the past is read, and no label.
        templates: Both are labelled with.
        planner: Grid and rules of reading for the blind planner.
        past_motion: Fitted to the same.

    Returns:
        `prior`, `standing_still` and `blind` [K], the same for all samples. [S, K], and knowing
        what cameras do not show: `speed_prior` the speed, `constant_velocity` also its sign,
        `constant_yaw_rate` also the rate of turning, both again `_with_prior`, and `past_motion`
        the last two seconds.
    """
    points, past, labels = templates.points, train.past, train.labels
    log_prior = fit_prior(labels, past.scene, len(points))
    known, split_known = _is_known(past), _is_known(split.futures)
    speed_prior = fit_speed_prior(_speed_mps(past), known, labels, past.scene, len(points))
    blind_planner = Planner(torch.from_numpy(points), planner.grid, planner.config)

    def driving_on(paths: _DrivingOn, with_prior: bool = False) -> Array:
        ours, asked = (
            paths(futures, templates.horizon_s, templates.dt_s) for futures in (past, split.futures)
        )
        return driving_on_log_prob(
            ours, known, labels, asked, split_known, points, log_prior, with_prior
        )

    return {
        "prior": log_prior,
        "speed_prior": speed_prior.of(_speed_mps(split.futures), split_known),
        "standing_still": standing_still_log_prob(points, labels),
        "constant_velocity": driving_on(_constant_velocity),
        "constant_velocity_with_prior": driving_on(_constant_velocity, with_prior=True),
        "constant_yaw_rate": driving_on(_constant_yaw_rate),
        "constant_yaw_rate_with_prior": driving_on(_constant_yaw_rate, with_prior=True),
        "past_motion": past_motion.log_prob(split.futures),
        "blind": fit_blind(blind_planner, labels, past.scene).log_prob,
    }


def _is_known(futures: Futures) -> NDArray[np.bool_]:
    """[S] whether there is a past to tell motion from; not where a recording begins."""
    return futures.past_known[:, 0]


def _speed_mps(futures: Futures) -> Array:
    speed_mps: Array = np.linalg.norm(futures.velocity_mps, axis=1)
    return speed_mps


def _constant_velocity(futures: Futures, horizon_s: float, dt_s: float) -> Array:
    return constant_velocity_futures(along_heading(futures.velocity_mps), horizon_s, dt_s)


def _constant_yaw_rate(futures: Futures, horizon_s: float, dt_s: float) -> Array:
    velocity_mps = along_heading(futures.velocity_mps)
    return constant_yaw_rate_futures(velocity_mps, futures.yaw_rate_radps, horizon_s, dt_s)
