"""What an evaluation found, as dataclasses and as the plain values of report.json."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from lss_core.files import write_atomically
from shoot.evaluation.check_basis import CheckBasis
from shoot.metrics.bootstrap import Groups, Interval
from shoot.metrics.calibration import Reliability

MODEL: Final = "model"
# The planner again, told the speed: no baseline.
KNOWING_SPEED: Final = "model_knowing_speed"


@dataclass(frozen=True)
class Results:
    """Every method on the same samples.

    Metrics:

    - `top1`, `top5`, `top10`, `top20` (%), `nll` (nats), `brier` (0 to 2), `ece` (%),
      `expected_ade` (m): of the ranking and the whole distribution;
    - `min_ade_k`, `min_fde_k` (m), `miss_rate_k` (%): of the k best-ranked templates;
    - of the chosen template, which is the most probable one: `l2_at_1s`, `l2_upto_1s`, ... (m), the
      distance at 1 s and the mean of those until 1 s; `lon_accel_mps2`, `lat_accel_mps2`,
      `jerk_mps3`, `comfort` (%); `collision_1s`, `off_road_1s`, ... (%), only if there were checks.

    Where templates have no point at 1 s, 2 s, ..., there is no metric of that time. A metric is a
    mean over the samples it applies to, NaN if there are none. A difference is over the samples
    where it applies to both.

    Attributes:
        num_samples: Samples.
        num_scenes: Scenes they come from.
        num_groups: What intervals are over: these scenes, or the logs they come from.
        methods: Method -> metric -> mean with interval.
        differences: Baseline -> metric -> model minus baseline, with paired interval; empty if
            there is no method called `model`.
        oracle: `ade`, `fde` (metres) and `miss_rate` (per cent) of the nearest template: what a
            planner that is always right would get.
        driver: Collisions, leaving the road and comfort of the driven paths themselves; empty if
            there were no checks.
        reliability: Method -> confidence beside accuracy, in bins of about equal mass.
    """

    num_samples: int
    num_scenes: int
    num_groups: int
    methods: dict[str, dict[str, Interval]]
    differences: dict[str, dict[str, Interval]]
    oracle: dict[str, Interval]
    driver: dict[str, Interval]
    reliability: dict[str, Reliability]

    def to_json(self) -> dict[str, Any]:
        """Plain values; what does not exist (a bound with one group only) is null."""
        return {
            "num_samples": self.num_samples,
            "num_scenes": self.num_scenes,
            "num_groups": self.num_groups,
            "methods": {name: _plain(metrics) for name, metrics in self.methods.items()},
            "differences": {name: _plain(metrics) for name, metrics in self.differences.items()},
            "oracle": _plain(self.oracle),
            "driver": _plain(self.driver),
            "reliability": {name: bins.to_json() for name, bins in self.reliability.items()},
        }


@dataclass(frozen=True)
class Report:
    """What `shoot-evaluate` has to say.

    Attributes:
        split: Name of the split.
        overall: All samples.
        by_manoeuvre: The samples of each manoeuvre that occurs.
        by_condition: The samples of each condition (day, night, ...) that occurs.
        by_speed: The samples of each range of speeds that occurs, by the speed at the sample; a
            range includes its lower end and not its upper. Not where the speed is unknown.
        num_boxes_left_out: Annotated boxes that the driver's own path touches, and that no path
            is therefore checked against: pairs of sample and object.
        num_samples_with_boxes_left_out: Samples that have such.
        by_scene: Scene -> `num_samples` and the model's mean `top10` (per cent) and `nll` (nats),
            and its `log` where these are resampled: enough to compare two runs with paired
            intervals.
        num_bad_samples: Samples left out because they cannot be used.
        resampled: What intervals are over.
        num_seen_scenes: Scenes that the run was trained on, or its templates fitted.
        rests_on: What collision and off-road rates rest on, or why there are none; None if paths
            were not checked.
    """

    split: str
    overall: Results
    by_manoeuvre: dict[str, Results]
    by_condition: dict[str, Results]
    by_speed: dict[str, Results]
    num_boxes_left_out: int = 0
    num_samples_with_boxes_left_out: int = 0
    by_scene: dict[str, dict[str, float | int | str]] = field(default_factory=dict)
    num_bad_samples: int = 0
    resampled: Groups = "scenes"
    num_seen_scenes: int = 0
    rests_on: CheckBasis | None = None

    def to_json(self) -> dict[str, Any]:
        """The form of report.json: plain dicts, lists, strings, numbers and null."""
        return {
            "split": self.split,
            "resampled": self.resampled,
            **self.overall.to_json(),
            "num_boxes_left_out": self.num_boxes_left_out,
            "num_samples_with_boxes_left_out": self.num_samples_with_boxes_left_out,
            "rests_on": None if self.rests_on is None else self.rests_on.to_json(),
            "num_bad_samples": self.num_bad_samples,
            "num_seen_scenes": self.num_seen_scenes,
            "by_manoeuvre": {name: part.to_json() for name, part in self.by_manoeuvre.items()},
            "by_condition": {name: part.to_json() for name, part in self.by_condition.items()},
            "by_speed": {name: part.to_json() for name, part in self.by_speed.items()},
            "by_scene": self.by_scene,
        }

    def save(self, path: str | Path) -> None:
        """Write report.json; it appears whole or not at all.

        Raises:
            OSError: If it cannot be written.
        """
        text = json.dumps(self.to_json(), indent=2, allow_nan=False) + "\n"
        with write_atomically(path) as stream:
            stream.write(text.encode())


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
