import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from world_fixture import TinyRun, TinySegmenter

from lss_core.errors import DataError
from shoot.prediction.run import open_run
from shoot.prediction.segmenter import open_segmenter, predict_maps, segment_batches


def test_maps_are_probabilities_of_each_sample_by_itself(tiny_segmenter: TinySegmenter) -> None:
    run = open_segmenter(tiny_segmenter.folder)
    split = run.task.load_split(run.config.data, "train")
    found = list(predict_maps(run, split))
    rows = torch.cat([batch.sensors.sample_idx for batch, _ in found])
    np.testing.assert_array_equal(rows.numpy(), split.rows)
    prob = torch.cat([prob for _, prob in found])
    assert prob.shape == (len(split), len(run.config.classes), *run.config.model.grid.shape)
    assert prob.min() >= 0.0
    assert prob.max() <= 1.0
    last = len(split) - 1
    (alone,) = segment_batches(run, split, np.array([last]))
    with torch.no_grad():
        logit = run.module(alone.sensors)
    torch.testing.assert_close(prob[last], torch.special.expit(logit[0]))
    assert torch.equal(alone.labels[0], found[-1][0].labels[-1])


def test_each_door_opens_runs_of_its_task_only(
    tiny_segmenter: TinySegmenter, tiny_run: TinyRun
) -> None:
    with pytest.raises(DataError, match="is a run of the task segmentation, where one of planning"):
        open_run(tiny_segmenter.folder)
    with pytest.raises(DataError, match="is a run of the task planning, where one of segmentation"):
        open_segmenter(tiny_run.folder)


def test_weights_of_other_classes_are_refused(
    tiny_segmenter: TinySegmenter, tmp_path: Path
) -> None:
    """As many channels, in another order: the weights would fit."""
    folder = tmp_path / "run"
    shutil.copytree(tiny_segmenter.folder, folder)
    file = folder / "config.yaml"
    config = yaml.safe_load(file.read_text())
    config["classes"] = config["classes"][::-1]
    file.write_text(yaml.safe_dump(config))
    with pytest.raises(DataError, match="was trained for the classes car vehicle"):
        open_segmenter(folder)
