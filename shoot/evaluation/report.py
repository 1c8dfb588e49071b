"""From log-probabilities of the model and its baselines to a report with intervals."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

from shoot.evaluation.results import MODEL, Report, Results
from shoot.evaluation.scoring import PathChecks, Scorer, Scores, select_samples
from shoot.metrics.bootstrap import GroupBootstrap, Interval
from shoot.metrics.calibration import calibration_error, calibration_terms, measure_reliability
from shoot.metrics.manoeuvres import MANOEUVRES, classify_manoeuvres
from shoot.metrics.ranks import PerSample
from shoot.trajectories import DT_S

Array = np.ndarray[Any, np.dtype[Any]]

_NIGHT = re.compile(r"\bnight\b", re.IGNORECASE)
_DUSK = re.compile(r"\bdusk\b", re.IGNORECASE)
_RAIN = re.compile(r"\brain(y|ing|s)?\b", re.IGNORECASE)
_SPEED_EDGES_MPS = (1.0, 5.0, 10.0)
_SPEEDS = ("0-1 m/s", "1-5 m/s", "5-10 m/s", "over 10 m/s")


def condition_of(description: str) -> str:
    """Light and weather from a scene's description: `day`, `night`, `rain`, `night rain`, ...

    nuScenes marks night and rain as words of the description, in any letter case; the synthetic
    world marks dusk too. What is not marked is dry day.
    """
    light = "night" if _NIGHT.search(description) else "dusk" if _DUSK.search(description) else ""
    rain = "rain" if _RAIN.search(description) else ""
    return " ".join(filter(None, (light, rain))) or "day"


def evaluate(
    log_probs: Mapping[str, Float[Array, "..."]],
    labels: Int[Array, " S"],
    futures: Float[Array, "S T 2"],
    templates: Float[Array, "K T 2"],
    scene_idx: Int[Array, " S"],
    conditions: Sequence[str],
    split: str,
    speed_mps: Float[Array, " S"],
    path_checks: PathChecks | None = None,
    logs: Shaped[Array, " S"] | None = None,
    dt_s: float = DT_S,
) -> Report:
    """Score every method on the same samples, beside each other and split up.

    Args:
        log_probs: Method -> log-probabilities in nats, [S, K]; or [K] where they are the same for
            all samples. `model` is compared with every other.
        labels: Nearest template of each sample.
        futures: Driven paths in metres in `ego`, every `dt_s`.
        templates: Templates in metres in `ego`, at the same times.
        scene_idx: Scene of each sample; intervals are over scenes, unless `logs` are given.
        conditions: Condition of each sample, see `condition_of`.
        split: Name of the split, for the report.
        speed_mps: Speed at each sample; NaN where it is not known.
        path_checks: From one path for each sample, in metres in `ego`, to `collision_1s`,
            `off_road_1s`, ... in per cent; asked about the chosen template of each method and about
            the driven path.
        logs: Log of each sample, where logs hold several scenes; intervals are then over logs.
        dt_s: Time of the first point, and between points.

    Raises:
        ValueError: If there are no samples, shapes do not fit, a method's values are not
            log-probabilities, or a label has probability 0.
    """
    num_samples = len(labels)
    if num_samples == 0:
        raise ValueError(f"Split '{split}' has no samples to evaluate.")
    if not len(futures) == len(scene_idx) == len(conditions) == len(speed_mps) == num_samples:
        raise ValueError(
            f"Evaluation needs one path, scene, condition and speed for each of {num_samples} "
            f"labels, got {len(futures)}, {len(scene_idx)}, {len(conditions)} and {len(speed_mps)}."
        )
    scorer = Scorer(labels, futures, templates, path_checks, dt_s)
    scores = {name: scorer.score(name, log_prob) for name, log_prob in log_probs.items()}
    nearest, driven = scorer.score_nearest(), scorer.score_driven()
    group = scene_idx if logs is None else logs

    def results(keep: Shaped[Array, " S"]) -> Results:
        return _summarise(
            {name: of_method.select(keep) for name, of_method in scores.items()},
            select_samples(nearest, keep),
            select_samples(driven, keep),
            scene_idx[keep],
            group[keep],
        )

    def parts(names: Sequence[str], name_of: Shaped[Array, " S"]) -> dict[str, Results]:
        return {name: results(name_of == name) for name in names if (name_of == name).any()}

    # The last name is for NaN, and of no part.
    speed_names = np.array([*_SPEEDS, ""])[
        np.where(np.isnan(speed_mps), len(_SPEEDS), np.digitize(speed_mps, _SPEED_EDGES_MPS))
    ]
    return Report(
        split=split,
        overall=results(np.ones(num_samples, dtype=bool)),
        by_manoeuvre=parts(MANOEUVRES, classify_manoeuvres(futures)),
        by_condition=parts(sorted(set(conditions)), np.array(conditions)),
        by_speed=parts(_SPEEDS, speed_names),
        resampled="scenes" if logs is None else "logs",
    )


def _summarise(
    scores: Mapping[str, Scores],
    nearest: PerSample,
    driven: PerSample,
    scene_idx: Int[Array, " S"],
    group: Shaped[Array, " S"],
) -> Results:
    """Means with intervals; all from the same draws of groups."""
    bootstrap = GroupBootstrap(group)
    terms = {name: calibration_terms(it.confidence, it.hit) for name, it in scores.items()}
    baselines = [name for name in scores if MODEL in scores and name != MODEL]
    return Results(
        num_samples=len(scene_idx),
        num_scenes=len(np.unique(scene_idx)),
        num_groups=bootstrap.num_groups,
        methods={
            name: _intervals(bootstrap, it.metrics)
            | {"ece": bootstrap.statistic(terms[name], calibration_error)}
            for name, it in scores.items()
        },
        differences={
            name: _intervals(
                bootstrap,
                {key: scores[MODEL].metrics[key] - it for key, it in scores[name].metrics.items()},
            )
            | {"ece": _calibration_difference(bootstrap, terms[MODEL], terms[name])}
            for name in baselines
        },
        oracle=_intervals(bootstrap, nearest),
        driver=_intervals(bootstrap, driven),
        reliability={
            name: measure_reliability(it.confidence, it.hit) for name, it in scores.items()
        },
    )


def _intervals(bootstrap: GroupBootstrap, metrics: PerSample) -> dict[str, Interval]:
    if not metrics:
        return {}
    found = bootstrap.intervals(np.stack(list(metrics.values()), axis=1).astype(np.float64))
    return dict(zip(metrics, found, strict=True))


def _calibration_difference(
    bootstrap: GroupBootstrap, ours: Float[Array, "S I"], theirs: Float[Array, "S J"]
) -> Interval:
    """ECE of one method minus that of another, in the same draws."""
    num_ours = ours.shape[1]

    def difference(sums: Float[Array, "D N"]) -> Float[Array, " D"]:
        less: Array = calibration_error(sums[:, :num_ours]) - calibration_error(sums[:, num_ours:])
        return less

    return bootstrap.statistic(np.concatenate([ours, theirs], axis=1), difference)
