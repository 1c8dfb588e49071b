import math
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import yaml

from lss_core.config import DataConfig, DepthBins, ImageConfig, ModelConfig
from lss_core.errors import DataError
from lss_core.grid import BevGrid
from shoot.planner import PlannerConfig
from shoot.training.config import OptimConfig
from shoot.training.planning.config import DEMO, PAPER, PRESETS, TrainConfig


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_come_back_from_yaml(tmp_path: Path, preset: str) -> None:
    config = PRESETS[preset][1]
    config.save(tmp_path / "config.yaml")
    assert TrainConfig.load(tmp_path / "config.yaml") == config


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_train_on_far_more_than_they_validate_on(preset: str) -> None:
    config = PRESETS[preset][1]
    num_validations = math.ceil(config.optim.steps / config.val_every)
    assert num_validations * config.val_samples > 0
    assert num_validations * config.val_samples <= config.optim.steps * config.optim.batch_size / 5


def test_every_changed_field_comes_back(tmp_path: Path) -> None:
    config = TrainConfig(
        templates="t's: file.npz",
        out="näme",
        data=DataConfig(
            root="~/x",
            version="v1.0-mini",
            image=ImageConfig(64, 96, (0.5, 0.75), (0.0, 0.1), 0.0, False),
            cameras=("CAM_BACK", "CAM_LEFT", "CAM_RIGHT"),
            ego_motion=False,
            skip_bad=True,
            drop_cameras=2,
            extrinsic_noise_rad=1e-7,
        ),
        model=ModelConfig(
            pretrained="none",
            frustum="released",
            depth=DepthBins(1.0, 9.0, 0.25),
            grid=BevGrid(-1.0, 5.0, -3.0, 3.0, 0.1),
        ),
        planner=PlannerConfig("nearest", "border", True, "volume"),
        optim=OptimConfig(steps=7, learning_rate=1e-5, schedule="cosine"),
        precision="bf16-mixed",
        deterministic=True,
        seed=12,
        resume=True,
    )
    config.save(tmp_path / "config.yaml")
    loaded = TrainConfig.load(tmp_path / "config.yaml")
    assert loaded == config
    assert isinstance(loaded.data.cameras, tuple)
    assert isinstance(loaded.model.grid, BevGrid)


def test_settings_of_older_runs_are_understood(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    for skip_bad in (True, False):
        config = replace(PAPER, data=replace(PAPER.data, skip_bad=skip_bad))
        config.save(path)
        path.write_text(path.read_text().replace("skip_bad", "skip_missing"))
        assert "skip_missing" in path.read_text()
        assert TrainConfig.load(path) == config


def test_runs_of_before_there_were_volumes_have_a_map_and_cross_entropy(tmp_path: Path) -> None:
    path = tmp_path / "config.yaml"
    PAPER.save(path)
    loaded = yaml.safe_load(path.read_text())
    for name in ("cost", "loss", "margin_per_m"):
        del loaded["planner"][name]
    path.write_text(yaml.safe_dump(loaded))
    assert TrainConfig.load(path) == PAPER
    assert (PAPER.planner.cost, PAPER.planner.loss) == ("map", "cross_entropy")


@pytest.mark.parametrize(
    ("place", "name"),
    [((), "sede"), (("data",), "rot"), (("data", "image"), "flipp"), (("model", "grid"), "cells")],
)
def test_misspelt_keys_are_refused(tmp_path: Path, place: tuple[str, ...], name: str) -> None:
    path = tmp_path / "config.yaml"
    PAPER.save(path)
    loaded = yaml.safe_load(path.read_text())
    part = loaded
    for key in place:
        part = part[key]
    part[name] = 1
    path.write_text(yaml.safe_dump(loaded))
    with pytest.raises(DataError, match=rf"no training config \({'.'.join([*place, name])}: .*\)"):
        TrainConfig.load(path)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("optim", "steps"), 0),
        (("optim", "steps"), "many"),
        (("planner", "off_grid"), "ignore"),
        (("model", "grid", "cell_m"), 0.3),
        (("model", "depth", "min_m"), -1.0),
        (("precision",), "8"),
        (("val_every",), 0),
        (("data", "image"), None),
        (("optim", "clip_norm"), 0.0),
        (("optim", "learning_rate"), float("nan")),
        (("data", "cameras"), ["CAM_FRONT", "CAM_FRONT"]),
        (("data", "image", "resize"), [1.2, 0.9]),
        (("model", "grid", "x_max_m"), float("inf")),
        (("model", "image_stride"), 4),
        (("seed",), -1),
    ],
)
def test_values_out_of_range_are_refused(
    tmp_path: Path, place: tuple[str, ...], value: object
) -> None:
    path = tmp_path / "config.yaml"
    PAPER.save(path)
    loaded = yaml.safe_load(path.read_text())
    part = loaded
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    path.write_text(yaml.safe_dump(loaded))
    with pytest.raises(DataError, match=f"no training config.*({'|'.join(place[-2:])})"):
        TrainConfig.load(path)


@pytest.mark.parametrize("text", [b"", b"[1, 2]", b"a: [", b"\xff\xfe\x00", b"just text"])
def test_files_that_are_no_config(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "config.yaml"
    path.write_bytes(text)
    with pytest.raises(DataError, match="is no training config"):
        TrainConfig.load(path)


def test_missing_config_is_no_run_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"is no run folder: it has no config\.yaml"):
        TrainConfig.load(tmp_path / "config.yaml")


def test_paper_preset_has_the_papers_numbers() -> None:
    # Sections 4.1 and 5 of the paper.
    assert (PAPER.data.image.height_px, PAPER.data.image.width_px) == (128, 352)
    assert len(PAPER.data.cameras) == 6
    assert PAPER.model.grid.shape == (200, 200)
    depths_m = PAPER.model.depth.depths_m
    assert (len(depths_m), depths_m[0], depths_m[-1]) == (41, 4.0, 44.0)
    assert PAPER.model.context_channels == 64
    assert PAPER.model.backbone == "efficientnet_b0"
    assert PAPER.optim.learning_rate == 1e-3
    assert PAPER.optim.weight_decay == 1e-7
    assert PAPER.optim.steps == 300_000
    assert PAPER.optim.schedule == "constant"


def test_templates_of_five_seconds_fit_ahead_of_the_small_grid() -> None:
    grid = DEMO.model.grid
    assert grid.x_max_m >= 13.9 * 5.0  # 50 km/h for the whole horizon


def test_bad_settings_raise_at_once() -> None:
    with pytest.raises(ValueError, match="batch_size is 0"):
        OptimConfig(batch_size=0)
    with pytest.raises(ValueError, match="devices is 0"):
        replace(PAPER, devices=0)


def test_saving_changes_nothing(tmp_path: Path) -> None:
    before = asdict(DEMO)
    DEMO.save(tmp_path / "a.yaml")
    assert asdict(DEMO) == before
