import math

import torch
from torchmetrics.classification import MultilabelJaccardIndex

from shoot.training.segmentation.running_overlap import RunningOverlap


def masks(seed: int, num: int) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    share = torch.tensor([0.1, 0.5, 0.9])[:, None, None]
    predicted, truth = (torch.rand(num, 3, 7, 5, generator=generator) < share for _ in range(2))
    return predicted, truth


def test_it_is_one_intersection_over_one_union_not_a_mean_over_samples() -> None:
    metric = RunningOverlap(["car"])
    predicted, truth = (torch.zeros(2, 1, 1, 4, dtype=torch.bool) for _ in range(2))
    predicted[0, 0, 0, :1] = truth[0, 0, 0, :1] = True  # 1 of 1
    predicted[1, 0, 0, :2] = truth[1, 0, 0, 1:] = True  # 1 of 4
    metric.update(predicted, truth)
    assert metric.compute() == {"iou_car": 40.0, "iou": 40.0}


def test_batches_give_what_all_samples_at_once_and_torchmetrics_give() -> None:
    predicted, truth = masks(0, 9)
    metric, whole = RunningOverlap("abc"), RunningOverlap("abc")
    whole.update(predicted, truth)
    reference = MultilabelJaccardIndex(3, average="none")
    for part in (slice(0, 2), slice(2, 9)):
        metric.update(predicted[part], truth[part])
        reference.update(predicted[part].float(), truth[part].long())
    found, expected = metric.compute(), 100.0 * reference.compute()
    assert found == whole.compute()
    torch.testing.assert_close(
        torch.stack([found[f"iou_{name}"] for name in "abc"]).float(), expected
    )
    torch.testing.assert_close(found["iou"].float(), expected.mean())


def test_a_class_that_is_nowhere_has_no_part_in_the_mean() -> None:
    predicted, truth = masks(1, 2)
    predicted[:, 1] = truth[:, 1] = False
    metric = RunningOverlap("abc")
    metric.update(predicted, truth)
    found = metric.compute()
    assert math.isnan(found["iou_b"])
    assert found["iou"] == (found["iou_a"] + found["iou_c"]) / 2
