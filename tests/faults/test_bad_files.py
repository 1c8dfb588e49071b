"""Templates, checkpoints and run folders from strangers run no code and fill no memory."""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tally import throw
from world_fixture import Said, TinyRun, command, complaint, evaluate, train_flags

from lss_core.errors import DataError
from shoot.prediction.run import open_run
from shoot.templates import TemplateSet
from shoot.training.planning.run_folder import PlanningRun

REFUSED = "refused in one sentence, no code run, no memory filled"


class Malice:
    """Unpickled, it makes a file."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> Any:
        return (Path.touch, (self.trace,))


# Templates


def entry(array: Any) -> bytes:
    """An array as a member of an npz file."""
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def header_only(shape: str, dtype: str = "<f4") -> bytes:
    """An array's header, without the numbers that it promises."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def npz(path: Path, pack: int = zipfile.ZIP_DEFLATED, **members: Any) -> None:
    """A template file of its own kind: the right members, but for those given as bytes."""
    card = json.dumps({"format_version": 1})
    good = {
        "templates": entry(np.zeros((3, 20, 2), np.float32)),
        "counts": entry(np.zeros(3, np.int64)),
        "dt_s": entry(np.float64(0.25)),
        "card": entry(np.asarray(card)),
    }
    with zipfile.ZipFile(path, "w", pack) as archive:
        for name, content in (good | members).items():
            if content is not None:
                archive.writestr(f"{name}.npy", content)


def deep(levels: int) -> str:
    return "[" * levels + "]" * levels


BAD_TEMPLATES: dict[str, dict[str, Any]] = {
    "bomb": {"templates": entry(np.zeros((1 << 21, 20, 2), np.float32))},
    "bomb beside": {"more": bytes((1 << 28) + 1)},
    "huge shape": {"templates": header_only("(1000000000000, 20, 2)")},
    "shape beyond 64 bits": {"templates": header_only("(1000000000000, 1000000000000, 2)")},
    "negative shape": {"templates": header_only("(-3, 20, 2)")},
    "shape that is a call": {"templates": header_only("__import__('os').getcwd()")},
    "float64": {"templates": entry(np.zeros((3, 20, 2)))},
    "texts": {"templates": entry(np.full((3, 20, 2), "1"))},
    "complex": {"templates": entry(np.zeros((3, 20, 2), np.complex64))},
    "records": {"templates": entry(np.zeros(3, [("x", "f4"), ("y", "f4")]))},
    "three coordinates": {"templates": entry(np.zeros((3, 20, 3), np.float32))},
    "no template": {"templates": entry(np.zeros((0, 20, 2), np.float32))},
    "not finite": {"templates": entry(np.full((3, 20, 2), np.inf, np.float32))},
    "counts of others": {"counts": entry(np.zeros(4, np.int64))},
    "counts that are floats": {"counts": entry(np.zeros(3))},
    "negative counts": {"counts": entry(np.full(3, -1))},
    "time step 0": {"dt_s": entry(np.float64(0.0))},
    "time step nan": {"dt_s": entry(np.float64("nan"))},
    "time steps": {"dt_s": entry(np.asarray([0.25, 0.5]))},
    "card that is a list": {"card": entry(np.asarray("[]"))},
    "card that is deep": {"card": entry(np.asarray(deep(100_000)))},
    "card of another format": {"card": entry(np.asarray('{"format_version": 2}'))},
    "no card": {"card": None},
    "no templates": {"templates": None},
    "no header": {"templates": b"nothing"},
    "empty member": {"counts": b""},
}


@pytest.mark.parametrize("name", BAD_TEMPLATES)
def test_bad_templates_are_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "templates.npz"
    npz(path)
    TemplateSet.load(path)  # but for what is spoilt it is a template file
    npz(path, **BAD_TEMPLATES[name])
    with (
        throw("bad template files", REFUSED),
        pytest.raises(DataError, match=r"templates\.npz") as refusal,
    ):
        TemplateSet.load(path)
    assert len(refusal.value.sentence) < 600


def test_templates_cannot_run_code(tiny_run: TinyRun, tmp_path: Path) -> None:
    trace, path = tmp_path / "it-ran", tmp_path / "templates.npz"
    npz(path, templates=entry(np.asarray([Malice(trace)], dtype=object)))
    flags = train_flags(tiny_run.root, path, tmp_path / "run", 2, 1)
    with throw("template files that run code when unpickled", REFUSED):
        assert str(path) in complaint(command("shoot-train", *flags))
        assert not trace.exists()
    with np.load(path, allow_pickle=True) as stored:
        assert stored["templates"].dtype == object
    assert trace.exists()  # it is malicious indeed


# Checkpoints


def repack(path: Path) -> None:
    """Pack a checkpoint's members, as a zip bomb's are."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def spoil(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    """Change what a checkpoint holds."""

    def write(path: Path) -> None:
        state = torch.load(path, weights_only=True)
        change(state)
        torch.save(state, path)

    return write


def weight(state: dict[str, Any], value: Any) -> None:
    name = next(name for name in state["state_dict"] if name.endswith("weight"))
    state["state_dict"][name] = value


def moments(state: dict[str, Any]) -> None:
    first = next(iter(state["optimizer_states"][0]["state"].values()))
    first["exp_avg"] = torch.zeros(2, 3, 4)


BAD_CHECKPOINTS: dict[str, Callable[[Path], Any]] = {
    "empty": lambda path: path.write_bytes(b""),
    "text": lambda path: path.write_text("weights"),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "packed": repack,
    "a list": lambda path: torch.save([1, 2], path),
    "a tensor": lambda path: torch.save(torch.zeros(3), path),
    "old format": lambda path: torch.save(
        {"state_dict": {}}, path, _use_new_zipfile_serialization=False
    ),
    "no weights": spoil(lambda state: state.pop("state_dict")),
    "weights that are a list": spoil(lambda state: state.update(state_dict=[1])),
    "weights that are numbers": spoil(lambda state: weight(state, 3.0)),
    "no fingerprint": spoil(lambda state: state.pop("templates_sha256")),
    "weights missing": spoil(lambda state: state["state_dict"].clear()),
    "weights of no place": spoil(lambda s: s["state_dict"].update({"model.x": torch.zeros(1)})),
    "weights of another shape": spoil(lambda state: weight(state, torch.zeros(1, 2))),
    "a huge view": spoil(lambda state: weight(state, torch.zeros(1).expand(1 << 40))),
}
BAD_TO_GO_ON: dict[str, Callable[[Path], Any]] = {
    "no optimiser": spoil(lambda state: state.pop("optimizer_states")),
    "no moments": spoil(lambda state: state["optimizer_states"].clear()),
    "moments of another shape": spoil(moments),
    "no loops": spoil(lambda state: state.pop("loops")),
    "loops that are none": spoil(lambda state: state.update(loops={"fit_loop": 3})),
    "no schedule": spoil(lambda state: state.update(lr_schedulers=[{}])),
    "no callbacks' state": spoil(lambda state: state.update(callbacks=[1])),
    "no version": spoil(lambda state: state.pop("pytorch-lightning_version")),
}


@pytest.fixture
def unfinished(spoilt: TinyRun) -> TinyRun:
    """A run with four of its eight steps done."""
    config = spoilt.folder / "config.yaml"
    config.write_text(config.read_text().replace(" steps: 4", " steps: 8"))
    return spoilt


def go_on(run: TinyRun) -> Said:
    flags = train_flags(run.root, run.templates, run.folder, 8, 2)
    return command("shoot-train", *flags, "--resume")


def test_what_is_whole_goes_on(unfinished: TinyRun) -> None:
    said = go_on(unfinished)
    assert said.status == 0, said.err
    state = torch.load(unfinished.folder / "checkpoints" / "last.ckpt", weights_only=True)
    assert state["global_step"] == 8


@pytest.mark.parametrize("name", BAD_CHECKPOINTS | BAD_TO_GO_ON)
def test_bad_checkpoints_are_refused(name: str, unfinished: TinyRun) -> None:
    last = unfinished.folder / "checkpoints" / "last.ckpt"
    (BAD_CHECKPOINTS | BAD_TO_GO_ON)[name](last)
    bytes_before = last.read_bytes()
    with throw("bad checkpoints", REFUSED):
        if name in BAD_CHECKPOINTS:
            assert str(unfinished.folder) in complaint(evaluate(unfinished))
        said = go_on(unfinished)
        assert said.status == 2, said.err
        assert "Traceback" not in said.err
        assert str(last) in " ".join(said.err.split())
        assert last.read_bytes() == bytes_before


@pytest.mark.parametrize("key", ["state_dict", "more"])
def test_checkpoints_cannot_run_code(key: str, spoilt: TinyRun, tmp_path: Path) -> None:
    last, trace = spoilt.folder / "checkpoints" / "last.ckpt", tmp_path / "it-ran"
    state = torch.load(last, weights_only=True)
    torch.save({**state, key: Malice(trace)}, last)
    flags = train_flags(spoilt.root, spoilt.templates, spoilt.folder, 4, 2)
    with throw("checkpoints that run code when unpickled", REFUSED):
        assert str(last) in complaint(evaluate(spoilt))
        assert str(last) in complaint(command("shoot-train", *flags, "--resume"))
        assert not trace.exists()
    torch.load(last, weights_only=False)
    assert trace.exists()  # it is malicious indeed


# Runs as they are given to others: config, templates, weights


def test_weights_alone_are_enough(tiny_run: TinyRun, tmp_path: Path) -> None:
    given = tmp_path / "given"
    given.mkdir()
    for name in ("config.yaml", "templates.npz", "weights.safetensors"):
        shutil.copy(tiny_run.folder / name, given / name)
    ours, theirs = open_run(tiny_run.folder), open_run(given)
    assert ours.module.state_dict().keys() == theirs.module.state_dict().keys()
    for name, value in ours.module.state_dict().items():
        assert torch.equal(theirs.module.state_dict()[name], value), name
    with pytest.raises(DataError, match=r"no checkpoint '.*best\.ckpt'"):
        PlanningRun(given).weights("best")
    flags = train_flags(tiny_run.root, tiny_run.templates, given, 4, 2)
    for more in ([], ["--resume"]):
        said = complaint(command("shoot-train", *flags, *more))
        assert "holds the weights of a finished run" in said


@pytest.mark.parametrize("content", [b"", b"\xff" * 64, (1 << 40).to_bytes(8, "little") + b"{}"])
def test_weights_that_are_none_are_refused(
    content: bytes, tiny_run: TinyRun, tmp_path: Path
) -> None:
    run = TinyRun(tiny_run.root, tiny_run.templates, tmp_path / "given")
    run.folder.mkdir()
    for name in ("config.yaml", "templates.npz"):
        shutil.copy(tiny_run.folder / name, run.folder / name)
    (run.folder / "weights.safetensors").write_bytes(content)
    with throw("bad weights", REFUSED):
        assert "weights.safetensors" in complaint(evaluate(run))


BAD_CONFIGS = {
    "object": "!!python/object/apply:os.system ['touch {trace}']",
    "channels": "model: {{stem_channels: 100000000000}}",
    "negative channels": "model: {{stem_channels: -4}}",
    "depths": "model: {{depth: {{step_m: 1.0e-12}}}}",
    "cells": "model: {{grid: {{cell_m: 1.0e-6}}}}",
    "image": "data: {{image: {{height_px: 32000000, width_px: 96}}}}",
    "image of no cells": "data: {{image: {{height_px: 33}}}}",
    "aliases": "a: &a [x, x]\nb: &b [*a, *a]\ncameras: [*b, *b]",
    "backbone": "model: {{backbone: 'hf-hub:stranger/network'}}",
    "backbone of a folder": "model: {{backbone: 'local-dir:/tmp'}}",
    "number as a name": "val_split: 3.5",
    "text": "plain text",
    "nothing": "",
}


@pytest.mark.parametrize("name", BAD_CONFIGS)
def test_bad_configs_are_refused(name: str, spoilt: TinyRun, tmp_path: Path) -> None:
    config, trace = spoilt.folder / "config.yaml", tmp_path / "it-ran"
    config.write_text(
        "templates: t.npz\nout: r\n" * (name not in ("text", "nothing"))
        + BAD_CONFIGS[name].format(trace=trace)
        + "\n"
    )
    with throw("bad run configs", REFUSED):
        said = evaluate(spoilt)
        assert said.status == 2, said.err
        assert "Traceback" not in said.err
        assert str(spoilt.folder) in " ".join(said.err.split()) or "backbone" in said.err.lower()
        assert not trace.exists()
