"""Intersection over union of a validation, summed up batch by batch."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool
from torch import Tensor
from torchmetrics import Metric


class RunningOverlap(Metric):
    """IoU of each class over all cells of all samples: one intersection over one union.

    States are sums, so batches of any size and processes with different numbers of batches give
    what all samples at once would.

    Args:
        classes: Names of the channels.
    """

    full_state_update = False
    higher_is_better = True
    is_differentiable = False

    intersection: Tensor
    union: Tensor

    def __init__(self, classes: Sequence[str]) -> None:
        super().__init__()
        self.classes = tuple(classes)
        for name in ("intersection", "union"):
            zeros = torch.zeros(len(self.classes), dtype=torch.long)
            self.add_state(name, zeros, dist_reduce_fx="sum")

    def update(self, predicted: Bool[Tensor, "B C X Y"], truth: Bool[Tensor, "B C X Y"]) -> None:
        """Add a batch: which cells are said to be of a class, and which are."""
        self.intersection += (predicted & truth).sum(dim=(0, 2, 3))
        self.union += (predicted | truth).sum(dim=(0, 2, 3))

    def compute(self) -> dict[str, Tensor]:
        """`iou_` and a class's name, and `iou`, their mean, in per cent.

        A class that neither is nor is said to be anywhere has no IoU (NaN) and no part in the mean.
        """
        iou = 100.0 * self.intersection.double() / self.union
        by_class = {f"iou_{name}": one for name, one in zip(self.classes, iou, strict=True)}
        return {**by_class, "iou": iou.nanmean()}
