"""The report as text: it holds what it should and fits 80 columns."""

import numpy as np
import pytest
from report_case import check_against_wall, evaluate_scene, make_case
from scipy.special import log_softmax

from shoot.evaluation.report import evaluate
from shoot.report.terminal import format_table


@pytest.fixture(scope="module")
def case():
    return make_case()


@pytest.fixture(scope="module")
def report(case):
    return evaluate(**case)


@pytest.fixture(scope="module")
def checked(case):
    return evaluate(**case, path_checks=check_against_wall)


def test_table_shows_methods_differences_and_parts_in_80_columns(report):
    text = format_table(report)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    top10 = report.overall.methods["model"]["top10"]
    assert any(line.split()[:1] == ["model"] and f"{top10.value:.1f}" in line for line in lines)
    assert f"[{top10.low:.1f}, {top10.high:.1f}]" in text
    difference = report.overall.differences["prior"]["nll"]
    assert f"[{difference.low:+.2f}, {difference.high:+.2f}]" in text
    first = {line.split()[0] for line in lines if line}
    assert {"standing", "straight", "day", "rain", "0-1", "over"} <= first
    assert not {"driver", "crash"} & set(text.split())


def _driving_row(text, name):
    """The method's row in the second table."""
    rows = text[text.index("Calibration, distances, safety") :].splitlines()
    return next(line.split()[1:] for line in rows if line.split()[:1] == [name])


def test_table_shows_distances_and_safety(checked):
    text = format_table(checked)
    model = {key: metric.value for key, metric in checked.overall.methods["model"].items()}
    assert _driving_row(text, "model") == [
        f"{model['ece']:.1f}",
        f"{model['brier']:.2f}",
        f"{model['expected_ade']:.2f}",
        f"{model['min_ade_10']:.2f}",
        f"{model['l2_at_3s']:.2f}",
        f"{model['l2_upto_3s']:.2f}",
        f"{model['collision_3s']:.1f}",
        f"{model['off_road_3s']:.1f}",
        f"{model['comfort']:.0f}",
    ]
    driver = checked.overall.driver
    assert _driving_row(text, "driver") == [
        f"{driver['collision_3s'].value:.1f}",
        "0.0",
        f"{driver['comfort'].value:.0f}",
    ]


def test_table_of_nine_methods_fits_80_columns_and_shows_the_best_part_by_part(case):
    generator = np.random.default_rng(1)
    names = ["blind", "constant_velocity", "constant_yaw_rate", "ego_status_network", "a", "b", "c"]
    log_probs = case["log_probs"] | {
        name: log_softmax(generator.normal(size=(240, 30)), axis=1) for name in names
    }
    log_probs["b"], log_probs["constant_yaw_rate"] = [case["log_probs"]["model"]] * 2
    text = format_table(evaluate(**case | {"log_probs": log_probs}, path_checks=check_against_wall))
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert "\N{HORIZONTAL ELLIPSIS}" not in text  # nothing is cut off
    header = lines[next(i for i, line in enumerate(lines) if "Part by part" in line) + 2 :][:2]
    assert {"model", "prior", "yaw", "b"} <= set(" ".join(header).split())
    assert not {"blind", "network", "a"} & set(" ".join(header).split())


def test_table_shows_what_does_not_apply_as_a_dash(case):
    text = format_table(evaluate_scene(case, 50))
    assert _driving_row(text, "model")[-3:-1] == ["-", "-"]
    assert "nan" not in text


@pytest.mark.parametrize(
    ("num_points", "dt_s", "shown"),
    [(20, 0.25, "3 s"), (8, 0.25, "2 s"), (10, 0.5, "3 s"), (5, 0.4, "2 s"), (6, 0.3, None)],
)
def test_table_shows_the_latest_moment_that_there_is(case, num_points, dt_s, shown):
    shorter = {name: case[name][:, :num_points] for name in ("futures", "templates")}
    text = " ".join(format_table(evaluate(**case | shorter, dt_s=dt_s)).split())
    said = f"L2: distance of the most probable template at {shown}"
    assert said in text if shown else "L2" not in text
    assert ("mean L2" in text) == (dt_s in (0.25, 0.5))
