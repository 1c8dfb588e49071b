"""The table of a GPU: its pieces, tried on the CPU, and what is said where there is no GPU."""

import importlib
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from lss_core.config import DepthBins, ImageConfig, ModelConfig
from lss_core.grid import BevGrid

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Everything small: one sample in 32 x 64 pixels."""
    monkeypatch.syspath_prepend(SCRIPTS)
    gpu = importlib.import_module("benchmarks.gpu")
    model = ModelConfig(
        backbone="plain-8-16-16",
        pretrained="none",
        context_channels=8,
        neck_channels=8,
        stem_channels=8,
        decoder_channels=8,
        depth=DepthBins(4.0, 12.0, 2.0),
        grid=BevGrid(cell_m=2.5),
    )
    config = gpu.planning.CONFIG
    data = replace(config.data, image=ImageConfig(height_px=32, width_px=64))
    config = replace(config, model=model, data=data)
    return gpu.Work("cpu", config, compiled=False, batch_size=2, repeats=2, calls=1, steps=2)


def test_every_row_finds_both_sides_alike(work: Any) -> None:
    gpu = importlib.import_module("benchmarks.gpu")
    rows = {name: list(group()) for name, group in gpu.gpu_rows(work).items() if name != "step"}
    assert {name: len(of_group) for name, of_group in rows.items()} == {"splat": 2, "plan": 3}
    assert rows["splat"][0].checks[0].holds  # both maps are the same
    assert rows["plan"][0].checks[0].holds  # and so are the probabilities
    for row in (row for of_group in rows.values() for row in of_group):
        assert row.pair.plain_s.low > 0.0
        assert row.pair.fast_s.low > 0.0


def test_the_loop_of_shoot_train_is_timed(work: Any) -> None:
    gpu = importlib.import_module("benchmarks.gpu")
    (row,) = gpu.step_rows(work)
    assert "batch 2" in row.name
    assert row.pair.fast_s.low > 0.0
    assert row.pair.plain_s.low > 0.0


@pytest.mark.skipif(torch.cuda.is_available(), reason="There is a CUDA GPU here.")
def test_without_a_gpu_it_says_so_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(SCRIPTS)
    monkeypatch.setattr("sys.argv", ["benchmark.py", "--device", "cuda"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPTS / "benchmark.py"), run_name="__main__")
    said = capsys.readouterr()
    assert ended.value.code == 2
    assert said.out == ""
    assert "no CUDA GPU" in said.err
    assert len(said.err.splitlines()) == 1
