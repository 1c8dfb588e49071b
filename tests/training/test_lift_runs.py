"""Runs of the paper's baselines: trained, opened and asked as any other."""

from pathlib import Path

import numpy as np
import pytest
from torch import nn
from world_fixture import TinyRun, command, train_flags

from shoot.prediction.run import open_run, predict
from shoot.training.planning.data import load_split


@pytest.mark.trains
@pytest.mark.parametrize("lift", ["cnn", "oft"])
def test_a_frozen_run_keeps_its_first_backbone(
    lift: str, tiny_run: TinyRun, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    flags = train_flags(tiny_run.root, tiny_run.templates, run, 2, 1)
    flags += ["--model.lift", lift, "--model.freeze-encoder"]
    said = command("shoot-train", *flags)
    assert said.status == 0, said.err
    trained = open_run(run)
    assert (trained.config.model.lift, trained.config.model.freeze_encoder) == (lift, True)
    encoder = trained.module.model.image_encoder
    steps_seen = {
        part: {int(m.num_batches_tracked) for m in net.modules() if isinstance(m, nn.BatchNorm2d)}
        for part, net in (("backbone", encoder.backbone), ("neck", encoder.neck))
    }
    assert steps_seen == {"backbone": {0}, "neck": {2}}
    split = load_split(trained.config.data, "val", trained.templates)
    assert np.ptp(predict(trained, split), axis=0).max() > 0.0
