"""A small data set, ways to spoil it, and what must be seen when it is used after that."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tiny_tables import VERSION, TinyScene, read_table, write_table

from lss_core.config import CAMERAS, DataConfig, ImageConfig
from lss_core.data.usable import LeftOut
from lss_core.errors import DataError
from shoot.templates import TemplateSet
from shoot.training.planning.data import LabelledSplit, PlanningDataset, load_split

OUTCOME = "one sentence that names file and record, or skipped, counted and listed"
CAMS = CAMERAS[:2]
# 13 keyframes, of which three have five seconds of future.
TRAIN = TinyScene("scene-0001", seconds=6.0)
BESIDE = TinyScene("scene-0002", seconds=6.0, speed_mps=3.0, yaw_rate_radps=-0.2)
NUM_WITH_FUTURE = 6  # of training
# Three speeds straight ahead.
TEMPLATES = TemplateSet(
    np.outer([0.0, 25.0, 50.0], np.linspace(0.05, 1.0, 20))[..., None].repeat(2, -1).astype("f4"),
    0.25,
    np.ones(3, dtype=np.int64),
)
TOKEN = "scene-0001-01"
LONGEST = 600

Record = dict[str, Any]
Spoil = Callable[[Path], object]


@dataclass(frozen=True)
class Case:
    """One way to spoil a data set.

    Attributes:
        kind: Its row in the tally.
        name: Short.
        spoil: Does it, given the data root.
        says: What the sentence has without the flag; None if there is none: all is well.
        skipped: Training samples listed with the flag; None: it ends as without.
        reason: Theirs.
        lidar: Scans that are read instead of images.
        used: Samples that are read if all is well.
    """

    kind: str
    name: str
    spoil: Spoil
    says: tuple[str, ...] | None
    skipped: int | None = None
    reason: str = ""
    lidar: int = 0
    used: int = NUM_WITH_FUTURE

    def __str__(self) -> str:
        return f"{self.kind}: {self.name}"


def change(table: str, token: str, **values: Any) -> Spoil:
    """Give a record other values; `...` takes a column away."""

    def spoil(root: Path) -> None:
        records = read_table(root, table)
        for record in records:
            if record["token"] == token:
                record |= values
                for name in [name for name, value in record.items() if value is ...]:
                    del record[name]
        write_table(root, table, records)

    return spoil


def rewrite(table: str, function: Callable[[list[Record]], list[Record]]) -> Spoil:
    """Make other records of a table's."""
    return lambda root: write_table(root, table, function(read_table(root, table)))


def image(root: Path, number: int = 1, camera: str = CAMS[0]) -> Path:
    return root / "samples" / camera / f"{TRAIN.name}-{number:02d}.jpg"


def sweep(root: Path, number: int = 1) -> Path:
    return root / "samples" / "LIDAR_TOP" / f"{TRAIN.name}-{5 * number:03d}.pcd.bin"


def frame_token(root: Path, channel: str, number: int = 1) -> str:
    """Of sensor record and pose of a keyframe of the first training scene."""
    return next(
        str(record["token"])
        for record in read_table(root, "sample_data")
        if record["sample_token"] == f"{TRAIN.name}-{number:02d}"
        and f"/{channel}/" in record["filename"]
        and record["is_key_frame"]
    )


def change_frame(table: str, channel: str, number: int = 1, **values: Any) -> Spoil:
    """Give a keyframe's sensor record, or its pose, other values."""
    return lambda root: change(table, frame_token(root, channel, number), **values)(root)


def config(root: Path, skip_bad: bool = False, lidar: int = 0) -> DataConfig:
    return DataConfig(
        root=str(root),
        version=VERSION,
        cameras=CAMS,
        image=ImageConfig(height_px=32, width_px=64),
        lidar_scans=lidar,
        skip_bad=skip_bad,
    )


@dataclass(frozen=True)
class Used:
    """What came of using a data set.

    Attributes:
        sentence: How it ended, if it did.
        tokens: Samples that were read.
        left_out: What was listed.
    """

    sentence: str | None
    tokens: frozenset[str] = frozenset()
    left_out: tuple[LeftOut, ...] = ()


def use(data: DataConfig, split: str = "train") -> Used:
    """Load a split and read each of its samples, as training does."""
    try:
        samples = load_split(data, split, TEMPLATES)
        check_items(samples, data)
    except DataError as error:
        check_sentence(error.sentence)
        return Used(error.sentence)
    tokens = samples.index.sample_token[samples.futures.sample].tolist()
    used = Used(None, frozenset(tokens), samples.left_out)
    assert len(used.tokens) == len(tokens)
    check_list(used)
    return used


def check_items(samples: LabelledSplit, data: DataConfig) -> None:
    """What a planner would get is sound."""
    items = PlanningDataset(samples, data, seed=0)
    for position in range(len(items)):
        item = items[position, -1]
        sensors = item.sensors
        for numbers in (
            item.future,
            sensors.points,
            sensors.ego_from_camera,
            sensors.pixel_from_camera,
        ):
            assert numbers.isfinite().all()
            assert numbers.abs().max() < 1e6 if numbers.numel() else True


def check_sentence(sentence: str) -> None:
    assert 20 < len(sentence) < LONGEST
    assert sentence.isprintable()
    assert "Traceback" not in sentence


def check_list(used: Used) -> None:
    """Each sample that is left out is listed once, by token, record and reason."""
    listed = [one.sample for one in used.left_out]
    assert len(set(listed)) == len(listed)
    assert not used.tokens & set(listed)
    for one in used.left_out:
        assert one.scene
        assert one.reason
        assert one.what


def check(case: Case, root: Path) -> None:
    """Use the spoilt data set without and with the flag."""
    plain = use(config(root, lidar=case.lidar))
    if case.says is None:
        assert plain.sentence is None
        assert len(plain.tokens) == case.used
    else:
        assert plain.sentence is not None
        for word in case.says:
            assert word in plain.sentence, plain.sentence
    skipping = use(config(root, skip_bad=True, lidar=case.lidar))
    if case.skipped is None:
        assert skipping == plain or skipping.sentence is not None
        assert (skipping.sentence is None) == (plain.sentence is None)
        assert not skipping.left_out
        return
    assert skipping.sentence is None
    assert len(skipping.left_out) == case.skipped
    assert {one.reason for one in skipping.left_out} == {case.reason}
    # All that can be used is; nothing is lost without a word.
    with_future = {f"{name}-{n:02d}" for name in (TRAIN.name, BESIDE.name) for n in range(3)}
    listed = {one.sample for one in skipping.left_out}
    assert skipping.tokens == with_future - listed
    for one in skipping.left_out:
        if case.says is not None:
            assert any(word in one.what for word in case.says), one.what


def spoilt_copy(source: Path, case: Case, target: Path) -> Path:
    shutil.copytree(source, target)
    case.spoil(target)
    return target
