"""From log-probabilities of the model and its baselines to a report with intervals."""

import io
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Float, Int, Shaped
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lss_core.files import write_atomically
from shoot.bootstrap import Interval, SceneBootstrap
from shoot.manoeuvres import MANOEUVRES, classify_manoeuvres
from shoot.metrics import (
    TOP_KS,
    min_ade,
    min_fde,
    misses,
    negative_log_likelihood,
    ranks,
    template_errors,
    top_templates,
)

Array = npt.NDArray[Any]
# Metric name to one value per sample, in the unit of the report.
PerSample = dict[str, Array]

MODEL = "model"

_NIGHT = re.compile(r"\bnight\b", re.IGNORECASE)
_DUSK = re.compile(r"\bdusk\b", re.IGNORECASE)
_RAIN = re.compile(r"\brain(y|ing|s)?\b", re.IGNORECASE)
_PART_COLUMNS = (("top10", "{:5.1f}"), ("nll", "{:5.2f}"))
_TABLE_COLUMNS = (
    ("top5", "top-5, %", "{:.1f}"),
    ("top10", "top-10, %", "{:.1f}"),
    ("top20", "top-20, %", "{:.1f}"),
    ("nll", "NLL, nats", "{:.2f}"),
)


@dataclass(frozen=True)
class Results:
    """Every method on the same samples.

    Metrics: `top1`, `top5`, `top10`, `top20` and `miss_rate_1`, ... in per cent, `nll` in nats,
    `min_ade_1`, ... and `min_fde_1`, ... in metres.

    Attributes:
        num_samples: Samples.
        num_scenes: Scenes they come from.
        methods: Method -> metric -> mean with interval.
        differences: Baseline -> metric -> model minus baseline, with paired interval; empty if
            there is no method called `model`.
        oracle: `ade`, `fde` (metres) and `miss_rate` (per cent) of the nearest template: what a
            planner that is always right would get.
    """

    num_samples: int
    num_scenes: int
    methods: dict[str, dict[str, Interval]]
    differences: dict[str, dict[str, Interval]]
    oracle: dict[str, Interval]

    def to_json(self) -> dict[str, Any]:
        """Plain values; a bound that does not exist (one scene only) is null."""
        return {
            "num_samples": self.num_samples,
            "num_scenes": self.num_scenes,
            "methods": {name: _plain(metrics) for name, metrics in self.methods.items()},
            "differences": {name: _plain(metrics) for name, metrics in self.differences.items()},
            "oracle": _plain(self.oracle),
        }


@dataclass(frozen=True)
class Report:
    """What `shoot-evaluate` has to say.

    Attributes:
        split: Name of the split.
        overall: All samples.
        by_manoeuvre: The samples of each manoeuvre that occurs.
        by_condition: The samples of each condition (day, night, ...) that occurs.
    """

    split: str
    overall: Results
    by_manoeuvre: dict[str, Results]
    by_condition: dict[str, Results]

    def to_json(self) -> dict[str, Any]:
        """The form of report.json: plain dicts, strings, numbers and null."""
        return {
            "split": self.split,
            **self.overall.to_json(),
            "by_manoeuvre": {name: part.to_json() for name, part in self.by_manoeuvre.items()},
            "by_condition": {name: part.to_json() for name, part in self.by_condition.items()},
        }

    def save(self, path: str | Path) -> None:
        """Write report.json; it appears whole or not at all."""
        text = json.dumps(self.to_json(), indent=2, allow_nan=False) + "\n"
        with write_atomically(path) as stream:
            stream.write(text.encode())


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
) -> Report:
    """Score every method on the same samples, beside each other and split up.

    Args:
        log_probs: Method -> log-probabilities in nats, [S, K]; or [K] where they are the same for
            all samples. `model` is compared with every other.
        labels: Nearest template of each sample.
        futures: Driven paths in metres in `ego`.
        templates: Templates in metres in `ego`.
        scene_idx: Scene of each sample; intervals are over scenes.
        conditions: Condition of each sample, see `condition_of`.
        split: Name of the split, for the report.

    Raises:
        ValueError: If there are no samples, shapes do not fit, a method's values are not
            log-probabilities, or a label has probability 0.
    """
    num_samples = len(labels)
    if num_samples == 0:
        raise ValueError(f"Split '{split}' has no samples to evaluate.")
    if not len(futures) == len(scene_idx) == len(conditions) == num_samples:
        raise ValueError(
            f"Evaluation needs one path, scene and condition for each of {num_samples} labels, "
            f"got {len(futures)}, {len(scene_idx)} and {len(conditions)}."
        )
    values = {
        name: _score_method(name, log_prob, labels, futures, templates)
        for name, log_prob in log_probs.items()
    }
    oracle = _score_oracle(labels, futures, templates)
    manoeuvres = classify_manoeuvres(futures)
    condition_names = np.array(conditions)

    def results(keep: Shaped[Array, " S"]) -> Results:
        return _summarise(
            {name: _take(metrics, keep) for name, metrics in values.items()},
            _take(oracle, keep),
            scene_idx[keep],
        )

    return Report(
        split=split,
        overall=results(np.ones(num_samples, dtype=bool)),
        by_manoeuvre={
            name: results(manoeuvres == name) for name in MANOEUVRES if (manoeuvres == name).any()
        },
        by_condition={
            str(name): results(condition_names == name) for name in np.unique(condition_names)
        },
    )


def format_table(report: Report, width: int = 80) -> str:
    """The report as text for a terminal: methods, differences, then the splits.

    Args:
        report: What to show.
        width: Columns of the terminal; 80 are enough for four methods.
    """
    overall = report.overall
    metres = ", ".join(
        f"{_spaced(name)} {metrics['min_ade_10'].value:.2f} m"
        for name, metrics in overall.methods.items()
    )
    nearest_m = overall.oracle["ade"].value
    table = Table(
        title=f"Split '{report.split}': {overall.num_samples} samples of {overall.num_scenes} "
        "scenes (95 % intervals over scenes)",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("method", max_width=14)
    for _, header, _ in _TABLE_COLUMNS:
        table.add_column(header, justify="right", no_wrap=True)
    for name, metrics in overall.methods.items():
        cells = (_cell(metrics[key], form) for key, _, form in _TABLE_COLUMNS)
        table.add_row(Text(_spaced(name)), *cells)
    table.add_section()
    for name, metrics in overall.differences.items():
        cells = (_cell(metrics[key], form.replace("{:", "{:+")) for key, _, form in _TABLE_COLUMNS)
        table.add_row(Text(f"{MODEL} minus {_spaced(name)}"), *cells)

    parts = Table(
        title="Part by part: top-10 %, NLL in nats", box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    parts.add_column("part")
    parts.add_column("samples", justify="right")
    parts.add_column("scenes", justify="right")
    for name in overall.methods:
        parts.add_column(_spaced(name), justify="right", min_width=11, max_width=11)
    for group in (report.by_manoeuvre, report.by_condition):
        parts.add_section()
        for part, results in group.items():
            cells = (
                Text(" ".join(form.format(metrics[key].value) for key, form in _PART_COLUMNS))
                for metrics in results.methods.values()
            )
            parts.add_row(part, str(results.num_samples), str(results.num_scenes), *cells)

    console = Console(file=io.StringIO(), width=width, color_system=None)
    with console.capture() as captured:
        console.print(table)
        console.print(f"minADE_10: {metres}; the nearest template: {nearest_m:.2f} m.\n")
        console.print(parts)
    return "\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n")


def _score_method(
    name: str,
    log_prob: Float[Array, "..."],
    labels: Int[Array, " S"],
    futures: Float[Array, "S T 2"],
    templates: Float[Array, "K T 2"],
) -> PerSample:
    """All metrics of one method, sample by sample, in the units of the report."""
    shape = (len(labels), len(templates))
    if log_prob.shape not in (shape, shape[1:]):
        raise ValueError(
            f"Log-probabilities of '{name}' must have shape {shape} or {shape[1:]}, "
            f"got {log_prob.shape}."
        )
    rows = np.atleast_2d(log_prob)
    total = np.exp(rows, dtype=np.float64).sum(axis=1)
    # Written so that NaN fails it; float32 log-softmax is good to about 1e-6 here.
    if not (np.abs(total - 1.0) < 1e-3).all():
        raise ValueError(
            f"'{name}' must give log-probabilities that sum to one, but they sum to "
            f"{total.min():g}..{total.max():g} (NaN: the model has diverged)."
        )
    # Methods that are the same for all samples are sorted once; their rows are views, not copies.
    best = np.broadcast_to(
        top_templates(rows, max(TOP_KS)), (len(labels), min(max(TOP_KS), len(templates)))
    )
    every = np.broadcast_to(rows, shape)
    rank = ranks(every, labels)
    nll = negative_log_likelihood(every, labels)
    if not np.isfinite(nll).all():
        raise ValueError(
            f"'{name}' gives probability 0 to a template that was driven; smooth it, so that its "
            "NLL is finite."
        )
    errors = template_errors(templates, futures, best)
    metrics = {f"top{k}": 100.0 * (rank < k) for k in TOP_KS} | {"nll": nll}
    metrics |= {f"min_ade_{k}": min_ade(errors, k) for k in TOP_KS}
    metrics |= {f"min_fde_{k}": min_fde(errors, k) for k in TOP_KS}
    metrics |= {f"miss_rate_{k}": 100.0 * misses(errors, k) for k in TOP_KS}
    return metrics


def _score_oracle(
    labels: Int[Array, " S"], futures: Float[Array, "S T 2"], templates: Float[Array, "K T 2"]
) -> PerSample:
    """Errors of the nearest template, sample by sample."""
    errors = template_errors(templates, futures, labels[:, None])
    return {
        "ade": min_ade(errors, 1),
        "fde": min_fde(errors, 1),
        "miss_rate": 100.0 * misses(errors, 1),
    }


def _summarise(
    values: Mapping[str, PerSample], oracle: PerSample, scene_idx: Int[Array, " S"]
) -> Results:
    """Means with intervals; all from the same draws of scenes."""
    bootstrap = SceneBootstrap(scene_idx)
    return Results(
        num_samples=len(scene_idx),
        num_scenes=bootstrap.num_scenes,
        methods={
            name: {key: bootstrap.interval(value) for key, value in metrics.items()}
            for name, metrics in values.items()
        },
        differences={
            name: {
                key: bootstrap.interval(values[MODEL][key] - value)
                for key, value in metrics.items()
            }
            for name, metrics in values.items()
            if MODEL in values and name != MODEL
        },
        oracle={key: bootstrap.interval(value) for key, value in oracle.items()},
    )


def _take(metrics: PerSample, keep: Shaped[Array, " S"]) -> PerSample:
    return {key: value[keep] for key, value in metrics.items()}


def _plain(metrics: Mapping[str, Interval]) -> dict[str, dict[str, float | None]]:
    """JSON has no NaN: null instead."""
    return {
        key: {
            bound: None if math.isnan(number) else number
            for bound, number in (
                ("value", interval.value),
                ("low", interval.low),
                ("high", interval.high),
            )
        }
        for key, interval in metrics.items()
    }


def _cell(interval: Interval, form: str) -> Text:
    """A mean, its interval (if it has one) beneath; as Text, since rich reads [ ] in str."""
    value = form.format(interval.value)
    if math.isnan(interval.low):
        return Text(value)
    return Text(f"{value}\n[{form.format(interval.low)}, {form.format(interval.high)}]")


def _spaced(name: str) -> str:
    """A name that can be broken into lines."""
    return name.replace("_", " ")
