"""The tables of docs/templates.md, from records and nothing else."""

import math
from collections.abc import Sequence

from planning_table.cells import markdown, model_spread, spread
from run_queue import Record, budget_of

from vocabulary_table.vocabularies import METHODS, SIZE

_NAMES = {
    "kmeans": "K-Means",
    "farthest": "farthest points",
    "cover": "cover",
    "medoids": "K-medoids",
    "factored": "paths x speeds",
}
_PLANNED = {
    "top1": "top-1, %",
    "top5": "top-5, %",
    "top10": "top-10, %",
    "top20": "top-20, %",
    "min_ade_10": "minADE_10, m",
}
_NOT_RUN = "Not run yet."


def all_tables(coverage: Sequence[Record], planners: Sequence[Record]) -> dict[str, str]:
    """Name to text.

    Args:
        coverage: Records of vocabularies.
        planners: Records of runs on them.
    """
    by_size = [r for r in planners if r["method"] == "kmeans"]
    return {
        "vocabularies-setting": _setting(coverage) if coverage else _NOT_RUN,
        "vocabularies-coverage": _coverage(coverage) if coverage else _NOT_RUN,
        "vocabularies-methods": _planners([r for r in planners if r["k"] == SIZE]),
        "vocabularies-sizes": _planners(by_size),
    }


def _setting(records: Sequence[Record]) -> str:
    one = records[0]
    train, val = (one["coverage"][split]["count"] for split in ("train", "val"))
    feel = one["driven_feel"]
    return (
        f"Fitted to {train} futures of {one['num_scenes'][0]} training scenes of the synthetic "
        f"city, measured on {val} of {one['num_scenes'][1]} validation scenes; seed {one['seed']}. "
        f"Processor time on {one['processor']}. Of the held-out drives themselves "
        f"{feel['infeasible_percent']:.1f} % are infeasible and "
        f"{feel['uncomfortable_percent']:.1f} % uncomfortable by the same figures."
    )


def _coverage(records: Sequence[Record]) -> str:
    rows = []
    for record in sorted(records, key=lambda r: (r["k"], METHODS.index(r["method"]))):
        val, train, feel = record["coverage"]["val"], record["coverage"]["train"], record["feel"]
        metres = (val["mean_m"], val["p95_m"], val["max_m"], train["mean_m"], train["max_m"])
        rows.append(
            [
                str(record["k"]),
                _NAMES[record["method"]],
                *(f"{value:.2f}" for value in metres),
                f"{feel['infeasible_percent']:.1f}",
                f"{feel['uncomfortable_percent']:.1f}",
                f"{record['fit_cpu_s']:.0f}",
                _found(record["settings"]),
            ]
        )
    header = [
        "K", "method", "mean, m", "95 %, m", "largest, m", "mean in training, m",
        "largest in training, m", "infeasible, %", "uncomfortable, %", "fit, s", "found",
    ]  # fmt: skip
    return markdown(header, rows)


def _found(settings: Record) -> str:
    if "epsilon_m" in settings:
        return f"epsilon {settings['epsilon_m']:.2f} m by {settings['num_covering']}"
    if "num_paths" in settings:
        return f"{settings['num_paths']} paths, {settings['num_profiles']} speeds"
    return ""


def _planners(records: Sequence[Record]) -> str:
    if not records:
        return _NOT_RUN
    kinds = sorted({(r["k"], METHODS.index(r["method"])) for r in records})
    rows = []
    for k, place in kinds:
        method = METHODS[place]
        own = [r for r in records if (r["k"], r["method"]) == (k, method)]
        seeds = ", ".join(str(r["seed"]) for r in own)
        rows.append(
            [
                f"{_NAMES[method]}, {k}: {seeds}",
                *(model_spread(own, metric) for metric in _PLANNED),
                spread(own, _nll_above_uniform, "nll"),
                spread(own[:1], lambda r: r["oracle"]["ade"], "ade"),
            ]
        )
    header = ["vocabulary: seeds", *_PLANNED.values(), "NLL - log K, nats", "oracle ADE, m"]
    return f"{budget_of(records)}\n\n{markdown(header, rows)}"


def _nll_above_uniform(record: Record) -> Record:
    """NLL minus that of K equal probabilities: comparable where K differs, as NLL is not."""
    found, uniform = record["methods"]["model"]["nll"], math.log(record["k"])
    return {end: None if found[end] is None else found[end] - uniform for end in found}
