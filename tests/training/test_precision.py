import pytest
import torch
from world_fixture import TinyRun, command, train_flags

from shoot.training import loop as training
from shoot.training import precision
from shoot.training.planning.run_folder import PlanningRun
from shoot.training.precision import fastest_precision


def machine(monkeypatch: pytest.MonkeyPatch, bfloat16_s: float) -> None:
    """One that takes 1 s in float32."""
    seconds = {torch.float32: 1.0, torch.bfloat16: bfloat16_s}
    monkeypatch.setattr(precision, "_convolution_s", seconds.__getitem__)


@pytest.mark.parametrize(
    ("bfloat16_s", "expected"), [(0.25, "bf16-mixed"), (0.95, "32-true"), (4.0, "32-true")]
)
def test_bfloat16_is_taken_where_it_is_clearly_faster(
    bfloat16_s: float, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine(monkeypatch, bfloat16_s)
    assert fastest_precision(torch.device("cpu")) == expected


def test_this_machine_can_be_asked() -> None:
    assert precision._convolution_s(torch.float32) > 0.0
    assert fastest_precision(torch.device("cpu")) in ("32-true", "bf16-mixed")


def test_a_run_keeps_the_precision_it_was_begun_with(
    tiny_run: TinyRun, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, folder, 2, 1)
    flags[flags.index("32-true")] = "auto"
    monkeypatch.setattr(training, "fastest_precision", lambda _: "bf16-mixed")
    said = command("shoot-train", *flags)
    assert said.status == 0, said.err
    assert PlanningRun(folder).config().precision == "bf16-mixed"
    monkeypatch.setattr(training, "fastest_precision", lambda _: "32-true")
    said = command("shoot-train", *flags, "--resume")
    assert said.status == 0, said.err
    assert PlanningRun(folder).config().precision == "bf16-mixed"
