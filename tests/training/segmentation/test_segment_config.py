import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lss_core.bounds import SettingError
from lss_core.errors import DataError
from shoot.training.config import task_of
from shoot.training.planning.config import DEMO, TrainConfig
from shoot.training.segmentation.config import PRESETS, SEGMENT, SegmentConfig


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_come_back_from_yaml(tmp_path: Path, preset: str) -> None:
    config = PRESETS[preset][1]
    config.save(tmp_path / "config.yaml")
    assert SegmentConfig.load(tmp_path / "config.yaml") == config
    assert task_of(tmp_path) == "segmentation"


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_train_on_far_more_than_they_validate_on(preset: str) -> None:
    config = PRESETS[preset][1]
    num_validations = math.ceil(config.optim.steps / config.val_every)
    assert num_validations * config.val_samples > 0
    assert num_validations * config.val_samples <= config.optim.steps * config.optim.batch_size / 5


@pytest.mark.parametrize(("preset", "objects"), [("segment-paper", 1.0), ("segment", 10.0)])
def test_lanes_weigh_five_times_as_in_the_paper(preset: str, objects: float) -> None:
    """And objects as much as all else, but where few steps must do."""
    config = PRESETS[preset][1]
    weights = dict(zip(config.classes, config.pos_weights, strict=True))
    assert weights == {"car": objects, "vehicle": objects, "drivable": 1.0, "lane_boundary": 5.0}


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"classes": ("car",)}, "There are 1 classes but 4 pos_weights"),
        ({"classes": (), "pos_weights": ()}, "classes is empty"),
        ({"classes": ("car", "car"), "pos_weights": (1.0, 1.0)}, "classes names car twice"),
        ({"pos_weights": (1.0, 1.0, 0.0, 1.0)}, "pos_weights is"),
    ],
)
def test_settings_that_do_not_fit_are_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SettingError, match=sentence):
        replace(SEGMENT, **changes)


def test_each_task_refuses_the_config_of_another(tmp_path: Path) -> None:
    DEMO.save(tmp_path / "config.yaml")
    assert task_of(tmp_path) == "planning"
    assert "task:" not in (tmp_path / "config.yaml").read_text()  # as all runs of before
    with pytest.raises(DataError, match="is a run of the task planning, where one of segmentation"):
        SegmentConfig.load(tmp_path / "config.yaml")
    SEGMENT.save(tmp_path / "config.yaml")
    with pytest.raises(DataError, match="is a run of the task segmentation, where one of planning"):
        TrainConfig.load(tmp_path / "config.yaml")


def test_no_run_folder_has_no_task(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is no run folder"):
        task_of(tmp_path)
