"""shoot-convert: what it makes of data sets of others passes shoot-check, trains and renders."""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from argoverse2_layout import LOOKS, write_log
from comma2k19_layout import write_segment
from filmed_drive import FilmedDrive
from kitti_odometry_layout import write_filmed
from kitti_raw_layout import write_kitti_raw
from PIL import Image
from world_fixture import SMALL_FLAGS, command, complaint

STEPS = 20


def kitti_odometry(src: Path) -> None:
    write_filmed(src, "03", FilmedDrive(8.0))
    write_filmed(src, "04", FilmedDrive(7.0, bend_radpm=-0.02))


def kitti_raw(src: Path) -> None:
    write_kitti_raw(src, {"0001": FilmedDrive(8.0), "0002": FilmedDrive(7.0, bend_radpm=-0.02)})


def argoverse2(src: Path) -> None:
    write_log(src / "train" / "a", FilmedDrive(8.0))
    write_log(src / "val" / "b", FilmedDrive(7.0, bend_radpm=-0.02))


def comma2k19(src: Path) -> None:
    drives = FilmedDrive(7.5, 20.0, 0.003), FilmedDrive(6.5, 18.0, -0.0015)
    for number, drive in enumerate(drives):
        write_segment(src / f"b0c9d2329ad1606b|2018-08-0{number}--08-34-47" / "4", drive)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "write", "cameras"),
    [
        pytest.param("kitti-odometry", kitti_odometry, ("CAM_FRONT",), marks=pytest.mark.full),
        ("kitti-raw", kitti_raw, ("CAM_FRONT", "CAM_FRONT_STEREO")),
        pytest.param("argoverse2", argoverse2, tuple(LOOKS), marks=pytest.mark.full),
        pytest.param("comma2k19", comma2k19, ("CAM_FRONT",), marks=pytest.mark.full),
    ],
)
def test_a_converted_data_set_is_sound_and_planned_with(
    kind: str, write: Callable[[Path], None], cameras: Sequence[str], tmp_path: Path
) -> None:
    write(tmp_path / "src")
    root, templates, run = tmp_path / "data", tmp_path / "templates.npz", tmp_path / "run"
    said = command("shoot-convert", kind, tmp_path / "src", "--out", root)
    assert said.status == 0, said.err
    data = ("--data.root", root, "--data.cameras", *cameras)
    said = command("shoot-check", *data, "--out", tmp_path / "checked")
    assert said.status == 0, said.out + said.err
    assert "warning" not in said.out.lower()
    said = command("shoot-fit-templates", *data, "--out", templates, "--k", 8)
    assert said.status == 0, said.err
    steps = ("--optim.steps", STEPS, "--val-every", STEPS, *SMALL_FLAGS)
    said = command("shoot-train", "demo", *data, "--templates", templates, "--out", run, *steps)
    assert said.status == 0, said.err
    with (run / "metrics.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert int(rows[-1]["step"]) == STEPS - 1
    # Images and labels of both splits were read.
    assert all(np.isfinite(float(row["train_loss"])) for row in rows)
    assert 0.0 < float(rows[-1]["val_nll"]) < 10.0
    said = command("shoot-render", run, "--out", tmp_path / "pictures", "--num", 1)
    assert said.status == 0, said.err
    (picture,) = (tmp_path / "pictures").glob("*.png")
    with Image.open(picture) as image:
        assert np.asarray(image).std() > 10.0


def test_nothing_is_converted_of_no_kind(tmp_path: Path) -> None:
    said = command("shoot-convert", "kitti", tmp_path, "--out", tmp_path / "data")
    assert said.status == 2
    assert "kitti-raw" in said.err


@pytest.mark.parametrize("kind", ["kitti-odometry", "kitti-raw", "argoverse2", "comma2k19"])
def test_an_absent_folder_is_named(kind: str, tmp_path: Path) -> None:
    said = command("shoot-convert", kind, tmp_path / "nowhere", "--out", tmp_path / "data")
    assert "nowhere" in complaint(said)
    assert not (tmp_path / "data").exists()
