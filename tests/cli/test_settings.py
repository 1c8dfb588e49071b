"""Settings that cannot be: refused by config class, saved config and command, in one sentence."""

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass, replace
from functools import partial
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

import jaxtyping
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lss_core.bounds import Bounds, SettingError, hints_of
from lss_core.config import DataConfig, DepthBins, ImageConfig, ModelConfig
from lss_core.grid import BevGrid
from shoot.cli.check import CheckConfig, CheckedData
from shoot.cli.convert import Argoverse2, Comma2k19, KittiOdometry, KittiRaw
from shoot.cli.demo import DemoConfig
from shoot.cli.evaluate import EvaluateConfig
from shoot.cli.export import ExportConfig
from shoot.cli.fit_templates import DataSource, FitTemplatesConfig
from shoot.cli.plan import PlanConfig
from shoot.cli.render import RenderConfig
from shoot.cli.simulate import SimulateConfig
from shoot.planner import PlannerConfig
from shoot.training.config import OptimConfig
from shoot.training.planning.config import DEMO, PAPER, PRESETS, TrainConfig
from shoot.world.config import MakeWorldConfig

NAN, INF = math.nan, math.inf
COUNT = (0, -1, 10**12)
SEED = (-1, 2**32, 2**64)
LENGTH = (0.0, -1.0, NAN, INF)
PLACE = (NAN, INF, -INF, 1e9)

# Each number of each config class with values that it cannot have.
IMPOSSIBLE: dict[type, dict[str, tuple[Any, ...]]] = {
    PlannerConfig: {"margin_per_m": (0.0, -0.1, 1e9, NAN, INF)},
    DepthBins: {
        "min_m": (*LENGTH, 45.0, 50.0),
        "max_m": (*LENGTH, 4.0, 3.0),
        "step_m": (*LENGTH, 90.0, 1e-6),
    },
    BevGrid: {
        "x_min_m": (*PLACE, 50.0, 60.0, 0.1),
        "x_max_m": (*PLACE, -50.0, -60.0),
        "y_min_m": (*PLACE, 50.0),
        "y_max_m": (*PLACE, -50.0),
        "cell_m": (*LENGTH, 0.3, 1e-9),
    },
    ImageConfig: {
        "height_px": (0, -8, 10**6),
        "width_px": (0, -8, 10**6),
        "resize": ((0.0, 0.0), (1.2, 0.9), (NAN, 1.0), (1.0, INF), (-1.0, 1.0), (1.0, 1e9)),
        "crop_bottom": ((0.5, 0.1), (-1.0, 0.0), (22.0, 22.0), (NAN, 0.1), (0.0, 1.0)),
        "rotate_rad": (-0.1, NAN, INF, 5.4),
        "horizon": ((-0.1, 0.2), (0.2, NAN), (0.6, 0.6)),
    },
    ModelConfig: {
        "context_channels": COUNT,
        "neck_channels": COUNT,
        "stem_channels": COUNT,
        "decoder_channels": (*COUNT, 1),
        "z_min_m": (*PLACE, 10.0, 11.0),
        "z_max_m": (*PLACE, -10.0, -11.0),
        "head_init_std": (-1.0, NAN, INF),
    },
    DataConfig: {
        "lidar_scans": (-1, 10**12),
        "drop_cameras": (-1, 6, 99),
        "extrinsic_noise_rad": (-0.1, NAN, INF, 4.0),
        "extrinsic_noise_m": (-0.1, NAN, INF, 1e9),
    },
    OptimConfig: {
        "steps": COUNT,
        "batch_size": COUNT,
        "learning_rate": (0.0, -1e-3, NAN, INF, 1e9),
        "weight_decay": (-1.0, NAN, INF),
        "clip_norm": (0.0, -1.0, NAN, INF),
        "warmup_steps": (-1, 10**12),
        "depth_weight": (-1.0, NAN, INF),
        "max_bad_steps": COUNT,
    },
    TrainConfig: {
        "val_every": COUNT,
        "val_samples": (-1, 10**12),
        "num_workers": (-1, 10**6),
        "devices": COUNT,
        "num_nodes": COUNT,
        "seed": SEED,
    },
    FitTemplatesConfig: {
        "k": COUNT,
        "seed": SEED,
        "horizon_s": (*LENGTH, 61.0, 4.1),
        "dt_s": (*LENGTH, 11.0, 1e-9, 0.3),
    },
    RenderConfig: {"num": COUNT},
    PlanConfig: {
        "speed_mps": (NAN, INF, -60.0, 1e9),
        "top": COUNT,
        "rate_hz": (0, -1, 10**4),
    },
    ExportConfig: {"int8": COUNT},
    SimulateConfig: {
        "routes": COUNT,
        "seed": SEED,
        "workers": COUNT,
        "duration_s": (0.0, 3.0, 90.0, NAN),
        "image_scale": (0.0, 2.0, NAN),
    },
    MakeWorldConfig: {
        "train_scenes": (-1, 701),
        "val_scenes": (-1, 151),
        "seed": SEED,
        "image_scale": (0.0, 2.0, NAN),
        "workers": COUNT,
        "scenes_per_town": COUNT,
        "duration_s": (0.0, 90.0, NAN),
        "keyframe_s": (0.0, -1.0, NAN),
        "tail_s": (-1.0, 20.0, NAN, INF),
        "lidar_azimuths": (-1, 10**6),
    },
    DemoConfig: {
        "first_scenes": COUNT,
        "train_scenes": (0, 701),
        "val_scenes": (0, 151),
        "k": COUNT,
        "steps": COUNT,
        "seed": SEED,
        "image_scale": (0.0, 2.0, NAN),
        "workers": COUNT,
    },
}

# What is no number.
IMPOSSIBLE_OTHERS: list[tuple[type, str, Any]] = [
    (DataConfig, "cameras", ()),
    (DataConfig, "cameras", ("CAM_FRONT", "CAM_FRONT")),
    (DataConfig, "cameras", ("CAM_FRONT", " ")),
    (DataConfig, "root", ""),
    (DataConfig, "version", " "),
    (DataSource, "cameras", ("CAM_FRONT", "CAM_FRONT")),
    (DataSource, "root", "a\0b"),
    (TrainConfig, "val_split", "train"),
    (TrainConfig, "templates", ""),
    (FitTemplatesConfig, "split", ""),
    (FitTemplatesConfig, "vocabulary", ""),
    (FitTemplatesConfig, "export", ""),
    (RenderConfig, "token", ""),
    (SimulateConfig, "run", ""),
    (SimulateConfig, "dask", ""),
    (EvaluateConfig, "html", ""),
    (CheckConfig, "out", ""),
    (KittiOdometry, "val", ("",)),
    (CheckedData, "cameras", ("CAM_FRONT", "CAM_FRONT")),
]

MAKE: dict[type, Callable[..., Any]] = {
    TrainConfig: partial(replace, PAPER),
    DataSource: partial(DataSource, root="data"),
    FitTemplatesConfig: partial(FitTemplatesConfig, DataSource("data"), "t.npz"),
    RenderConfig: partial(RenderConfig, "run", "pictures"),
    PlanConfig: partial(PlanConfig, Path("rig.yaml"), ("FRONT=front.jpg",)),
    EvaluateConfig: partial(EvaluateConfig, "run"),
    ExportConfig: partial(ExportConfig, "run"),
    CheckConfig: partial(CheckConfig, CheckedData("data")),
    CheckedData: partial(CheckedData, "data"),
    MakeWorldConfig: partial(MakeWorldConfig, Path("world")),
    KittiOdometry: partial(KittiOdometry, Path("kitti"), Path("data")),
}
COMMANDS = (
    TrainConfig,
    FitTemplatesConfig,
    RenderConfig,
    EvaluateConfig,
    CheckConfig,
    MakeWorldConfig,
    DemoConfig,
    SimulateConfig,
    KittiOdometry,
    KittiRaw,
    Argoverse2,
    Comma2k19,
    PlanConfig,
    ExportConfig,
)


def make(config_type: type, **settings: Any) -> Any:
    return MAKE.get(config_type, config_type)(**settings)


def parts_of(config_type: type) -> Iterator[type]:
    """A config class and those within it."""
    yield config_type
    for hint in hints_of(config_type).values():
        if is_dataclass(hint):
            yield from parts_of(hint)  # type: ignore[arg-type]


def is_number(hint: Any) -> bool:
    if get_origin(hint) in (Annotated, tuple, UnionType):  # of a union the first
        return is_number(get_args(hint)[0])
    return hint in (int, float)


def test_every_number_of_every_command_has_bounds_and_stands_in_the_table() -> None:
    every = {part for config_type in COMMANDS for part in parts_of(config_type)}
    for part in every:
        numbers = {name: hint for name, hint in hints_of(part).items() if is_number(hint)}
        assert set(numbers) == set(IMPOSSIBLE.get(part, {})), part
        for name, hint in numbers.items():
            bounds = [extra for extra in hint.__metadata__ if isinstance(extra, Bounds)]
            assert bounds, f"{part.__name__}.{name}"


@pytest.mark.parametrize(
    ("config_type", "name", "value"),
    [
        *(
            (part, name, value)
            for part, row in IMPOSSIBLE.items()
            for name, values in row.items()
            for value in values
        ),
        *IMPOSSIBLE_OTHERS,
    ],
)
def test_what_cannot_be_is_refused_by_name(config_type: type, name: str, value: Any) -> None:
    with pytest.raises(SettingError) as refused:
        make(config_type, **{name: value})
    sentence = str(refused.value)
    side = f"side {name[0]}" if config_type is BevGrid else name
    assert name in sentence or side in sentence or "cells" in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert len(sentence) < 300


@given(data=st.data())
def test_numbers_within_bounds_are_taken_and_those_beyond_are_not(data: st.DataObject) -> None:
    config_type = data.draw(st.sampled_from(sorted(IMPOSSIBLE, key=lambda part: part.__name__)))
    name = data.draw(st.sampled_from(sorted(IMPOSSIBLE[config_type])))
    hint = hints_of(config_type)[name]
    bounds = next(extra for extra in hint.__metadata__ if isinstance(extra, Bounds))
    kind, low, high = get_args(hint)[0], bounds.low, bounds.high
    if get_origin(kind) is UnionType:  # with None, where it may be left to others
        kind = get_args(kind)[0]
    if kind is int:
        number = data.draw(st.integers(-(2**70), 2**70) | st.integers(int(low), int(high)))
    else:
        number = data.draw(st.floats() | st.floats(float(low), float(high)))
    value = number if kind in (int, float) else (number, number)
    if bounds.hold(number):
        with contextlib.suppress(SettingError):  # it may not fit the others
            make(config_type, **{name: value})
    else:
        with pytest.raises(SettingError, match=name):
            make(config_type, **{name: value})


@pytest.mark.parametrize("value", [2.5, "3", True, None])
def test_numbers_of_other_types_are_refused(value: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    # Users have none of the types that tests hold calls to.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(SettingError, match=r"steps is .*, but must be a whole number"):
        OptimConfig(steps=value)


def test_what_does_not_fit_together_is_refused() -> None:
    with pytest.raises(SettingError, match="height_px is 36, but must be a multiple of"):
        replace(DEMO, data=replace(DEMO.data, image=replace(DEMO.data.image, height_px=36)))
    with pytest.raises(SettingError, match="depth_weight needs two"):
        replace(
            DEMO,
            optim=replace(DEMO.optim, depth_weight=1.0),
            model=replace(DEMO.model, depth=DepthBins(4.0, 46.0, 42.0)),
        )
    with pytest.raises(SettingError, match="lift 'oft', which learns no depth"):
        replace(
            DEMO,
            optim=replace(DEMO.optim, depth_weight=1.0),
            model=replace(DEMO.model, lift="oft"),
        )
    # Of a lidar planner's no image needs to fit.
    lidar = PRESETS["lidar1"][1]
    replace(lidar, data=replace(lidar.data, image=replace(lidar.data.image, height_px=36)))
