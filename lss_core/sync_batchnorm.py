"""Batch norm over the samples of all processes, so that any number of them trains as one would.

PyTorch's own `SyncBatchNorm` does this on GPUs and refuses CPUs.
"""

from typing import Any

import torch
import torch.distributed as dist
import torch.nn.functional as F
from jaxtyping import Float
from timm.layers import BatchNormAct2d, convert_sync_batchnorm
from torch import Tensor, nn


def share_statistics(module: nn.Module, device: torch.device | str) -> nn.Module:
    """The module with each batch norm in it normalising over all processes' samples.

    Parameters, buffers and the names they are saved under stay the same. The module itself is
    changed; it is returned because a batch norm may be all there is.

    Args:
        module: Any; what comes after a norm in timm's norm-and-activation layers stays there.
        device: Where it will run.
    """
    if torch.device(device).type == "cuda":
        converted: nn.Module = convert_sync_batchnorm(module)
        return converted
    if isinstance(module, nn.BatchNorm2d) and not isinstance(module, JointBatchNorm2d):
        return JointBatchNorm2d(module)
    for name, child in module.named_children():
        setattr(module, name, share_statistics(child, device))
    return module


class JointBatchNorm2d(nn.BatchNorm2d):
    """A batch norm that normalises by mean and variance over all processes while it trains.

    Each process may have any number of samples but none. In evaluation, and where there is one
    process only, it is the layer it was made of.

    Args:
        original: Whose parameters and buffers it takes over, not as copies.
    """

    def __init__(self, original: nn.BatchNorm2d) -> None:
        super().__init__(
            original.num_features,
            original.eps,
            original.momentum,
            original.affine,
            original.track_running_stats,
        )
        self.weight, self.bias = original.weight, original.bias
        self.running_mean, self.running_var = original.running_mean, original.running_var
        self.num_batches_tracked = original.num_batches_tracked
        self.rest = nn.Sequential()
        if isinstance(original, BatchNormAct2d):
            self.rest.extend([original.drop, original.act])
        self.train(original.training)

    def forward(self, input: Float[Tensor, "B C H W"]) -> Float[Tensor, "B C H W"]:
        """The normalised maps, of the input's type."""
        if self.training and dist.is_initialized() and dist.get_world_size() > 1:
            normalised = self._normalise(input)
        else:
            normalised = super().forward(input)
        output: Tensor = self.rest(normalised)
        return output

    def _normalise(self, input: Tensor) -> Tensor:
        mean, variance, count = joint_statistics(input)
        if self.running_mean is not None and self.running_var is not None:
            assert self.num_batches_tracked is not None
            self.num_batches_tracked += 1
            new = 1.0 / float(self.num_batches_tracked) if self.momentum is None else self.momentum
            unbiased = variance * (count / (count - 1.0))
            self.running_mean.mul_(1.0 - new).add_(mean, alpha=new)
            self.running_var.mul_(1.0 - new).add_(unbiased, alpha=new)
        weight = torch.ones_like(mean) if self.weight is None else self.weight
        bias = torch.zeros_like(mean) if self.bias is None else self.bias
        return normalise_jointly(input, weight, bias, mean, variance, count, self.eps)


@torch.no_grad()
def joint_statistics(
    x: Float[Tensor, "B C H W"],
) -> tuple[Float[Tensor, "C"], Float[Tensor, "C"], Float[Tensor, ""]]:
    """Mean and variance of each channel over all processes, and how many values went into them.

    Every process must call it, with its own samples. Reduced-precision input has statistics in
    float32.

    Returns:
        Mean; variance around it (of the values, not an estimate for more of them); count.
    """
    # Its buffers only tell the type of the result.
    buffer = x.new_zeros(x.shape[1], dtype=torch.promote_types(x.dtype, torch.float32))
    mean, variance = torch.batch_norm_update_stats(x, buffer, buffer.clone(), 0.0)
    # Not sums of squares in x's own precision, of which nothing may be left where the mean is far
    # from zero: each process's variance is exact, and float64 has room for the mean beside it.
    own_mean, own_variance = mean.double(), variance.double()
    count = own_mean.new_tensor([x.numel() // len(mean)])
    sums = torch.cat([count, count * own_mean, count * (own_variance + own_mean.square())])
    dist.all_reduce(sums)
    averages = sums[1:] / sums[0]
    joint_mean, square = averages.chunk(2)
    joint_variance = (square - joint_mean.square()).clamp_(min=0.0)
    return joint_mean.to(mean.dtype), joint_variance.to(mean.dtype), sums[0].to(mean.dtype)


def normalise_jointly(
    x: Float[Tensor, "B C H W"],
    weight: Float[Tensor, "C"],
    bias: Float[Tensor, "C"],
    mean: Float[Tensor, "C"],
    variance: Float[Tensor, "C"],
    count: Float[Tensor, ""],
    eps: float,
) -> Float[Tensor, "B C H W"]:
    """`x` normalised by its `joint_statistics`, with gradients as if all processes were one.

    The gradient in `x` is that of the sum of all processes' losses; those in `weight` and `bias`
    hold this process's share, as those of any other layer do before DDP adds them up.
    """
    output: Tensor = _NormaliseJointly.apply(x, weight, bias, mean, variance, count, eps)
    return output


class _NormaliseJointly(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> Tensor:
        x, weight, bias, mean, variance, count, eps = inputs
        ctx.save_for_backward(x, weight, mean, variance, count)
        ctx.eps = eps
        return F.batch_norm(x, mean, variance, weight, bias, eps=eps)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Any) -> Any:
        (grad,) = grad_outputs
        x, weight, mean, variance, count = ctx.saved_tensors
        deviation_inv = (variance + ctx.eps).rsqrt()
        _, grad_weight, grad_bias = torch.ops.aten.native_batch_norm_backward(
            *(grad, x, weight, None, None, mean, deviation_inv, True, ctx.eps, [False, True, True])
        )
        sums = torch.cat([grad_weight, grad_bias])
        dist.all_reduce(sums)
        along_z, along_one = (sums / count).chunk(2)
        # With z for the normalised x: scale * (grad - z * mean of (z * grad) - mean of grad). Both
        # terms are batch norms with constants, whose kernel is fast in all types and layouts.
        scale = weight * deviation_inv
        zero, one = torch.zeros_like(scale), torch.ones_like(scale)
        grad_x = F.batch_norm(grad, zero, one, scale, zero, eps=0.0)
        grad_x += F.batch_norm(x, mean, variance, -scale * along_z, -scale * along_one, eps=ctx.eps)
        return grad_x, grad_weight, grad_bias, None, None, None, None
