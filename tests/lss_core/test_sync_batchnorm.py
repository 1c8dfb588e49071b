"""Batch norm over several processes equals one batch norm over all their samples."""

from pathlib import Path
from typing import Any

import pytest
import torch
import torch.distributed as dist
from timm.layers import BatchNormAct2d
from torch import Tensor, nn
from world_fixture import start_beside

from lss_core.sync_batchnorm import (
    JointBatchNorm2d,
    joint_statistics,
    normalise_jointly,
    share_statistics,
)

SHARES = (3, 1)  # samples of each process
CHANNELS = 5
PATIENCE_S = 120


def join_group(folder: Path, rank: int, processes: int) -> None:
    dist.init_process_group(
        "gloo", init_method=f"file://{folder / 'meet'}", rank=rank, world_size=processes
    )


def make_batch(dtype: torch.dtype, offset: float = 2.0) -> tuple[Tensor, Tensor]:
    """Maps of all processes, and what the loss weighs the outputs with."""
    generator = torch.Generator().manual_seed(5)
    shape = (sum(SHARES), CHANNELS, 4, 3)
    x = torch.randn(shape, generator=generator, dtype=torch.float64) + offset
    x[0] *= 3.0  # the shares have statistics of their own
    return x.to(dtype), torch.randn(shape, generator=generator, dtype=torch.float64)


def make_layer(kind: str) -> nn.BatchNorm2d:
    torch.manual_seed(6)
    layer: nn.BatchNorm2d
    if kind == "timm":
        layer = BatchNormAct2d(CHANNELS, act_layer=nn.SiLU, momentum=0.3)
    else:
        layer = nn.BatchNorm2d(
            CHANNELS, affine=kind != "bare", momentum=None if kind == "averaging" else 0.3
        )
    for value in layer.parameters():
        nn.init.normal_(value)
    return layer


def two_steps(layer: nn.Module, x: Tensor, weights: Tensor) -> dict[str, Tensor]:
    """What two forward and backward passes leave, and an output in evaluation."""
    found = {}
    for step in range(2):
        leaf = (x * (step + 1)).requires_grad_()
        output = layer(leaf)
        (output.double() * weights).square().sum().backward()
        assert leaf.grad is not None
        found |= {f"output{step}": output.detach(), f"grad{step}": leaf.grad}
    parameters = {f"grad.{name}": value.grad for name, value in layer.named_parameters()}
    return (
        found
        | layer.state_dict()
        | {name: grad for name, grad in parameters.items() if grad is not None}
        | {"evaluated": layer.eval()(x).detach()}
    )


CASES = [
    *((kind, torch.float64, 2.0) for kind in ("plain", "bare", "averaging", "timm")),
    ("plain", torch.float32, 1000.0),
    ("plain", torch.bfloat16, 2.0),
]


def run_share(folder: Path, rank: int) -> None:
    """Save what this process's share of every case comes to."""
    torch.set_num_threads(1)
    join_group(folder, rank, len(SHARES))
    results = []
    for kind, dtype, offset in CASES:
        own = slice(sum(SHARES[:rank]), sum(SHARES[: rank + 1]))
        x, weights = (part[own] for part in make_batch(dtype, offset))
        layer = make_layer(kind)
        if dtype == torch.float64:
            layer = layer.double()
        results.append(two_steps(share_statistics(nn.Sequential(layer), "cpu"), x, weights))
    torch.save(results, folder / f"{rank}.pt")


@pytest.fixture(scope="module")
def shares(tmp_path_factory: pytest.TempPathFactory) -> list[list[dict[str, Tensor]]]:
    """[process][case] of two processes."""
    folder = tmp_path_factory.mktemp("shares")
    started = [
        start_beside(run_share, folder, rank, log=folder / f"log{rank}")
        for rank in range(len(SHARES))
    ]
    for rank, process in enumerate(started):
        process.join(timeout=PATIENCE_S)
        process.kill()
        assert process.exitcode == 0, (folder / f"log{rank}").read_text()
    return [torch.load(folder / f"{rank}.pt") for rank in range(len(SHARES))]


@pytest.mark.parametrize("case", range(len(CASES)), ids=lambda case: f"{CASES[case][:2]}")
def test_two_processes_equal_one_layer_on_all_samples(
    case: int, shares: list[list[dict[str, Tensor]]]
) -> None:
    kind, dtype, offset = CASES[case]
    x, weights = make_batch(dtype, offset)
    # The statistics of mixed precision are float32: compare with the same samples in float32.
    layer = make_layer(kind)
    exact = nn.Sequential(layer.double())
    expected = two_steps(exact, x.double(), weights)
    ours = [results[case] for results in shares]
    assert ours[0].keys() == ours[1].keys() == expected.keys()
    # bfloat16 has 8 bits; float32 has 24, of which a mean of 1000 takes 10.
    rtol, atol = {
        torch.float64: (1e-10, 1e-12),
        torch.float32: (1e-3, 1e-3),
        torch.bfloat16: (4e-2, 4e-2),
    }[dtype]
    for name, value in expected.items():
        mine = [share[name] for share in ours]
        if name.startswith("grad."):
            joined = mine[0] + mine[1]
        elif name.startswith(("output", "grad", "evaluated")):
            joined = torch.cat(mine)
            assert joined.dtype == dtype
        else:
            assert torch.equal(mine[0], mine[1]), f"{name} differs between processes"
            joined = mine[0]
        torch.testing.assert_close(
            joined.to(value), value, rtol=rtol, atol=atol, msg=lambda m, n=name: f"{n}: {m}"
        )


def test_statistics_of_low_precision_are_float32(shares: list[list[dict[str, Tensor]]]) -> None:
    x, _ = make_batch(torch.bfloat16)
    own = shares[0][-1]
    layer = nn.BatchNorm2d(CHANNELS, momentum=0.3)
    for step in range(2):
        layer(x.float() * (step + 1))
    torch.testing.assert_close(own["0.running_mean"], layer.running_mean, rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(own["0.running_var"], layer.running_var, rtol=1e-5, atol=1e-6)


@pytest.fixture
def _alone(tmp_path: Path) -> Any:
    join_group(tmp_path, 0, 1)
    yield
    dist.destroy_process_group()


@pytest.mark.usefixtures("_alone")
def test_gradients_are_those_of_the_function() -> None:
    x, _ = make_batch(torch.float64)
    weight, bias = torch.randn(2, CHANNELS, dtype=torch.float64)

    def normalise(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        return normalise_jointly(x, weight, bias, *joint_statistics(x), 1e-5)

    leaves = [value.requires_grad_() for value in (x, weight, bias)]
    assert torch.autograd.gradcheck(normalise, leaves)


@pytest.mark.usefixtures("_alone")
def test_variance_survives_a_mean_far_from_zero() -> None:
    x, _ = make_batch(torch.float32, offset=1e4)
    _, variance, count = joint_statistics(x)
    exact = x.double().var(dim=(0, 2, 3), correction=0)
    assert count == x.numel() / CHANNELS
    torch.testing.assert_close(variance.double(), exact, rtol=1e-4, atol=0.0)


def make_net() -> nn.Module:
    norms = nn.Sequential(make_layer("timm"), make_layer("plain"))
    return nn.Sequential(nn.Conv2d(3, CHANNELS, 1), norms).eval()


def test_conversion_keeps_names_values_and_what_follows_a_norm() -> None:
    net = make_net()
    x = torch.randn(2, 3, 4, 4, generator=torch.Generator().manual_seed(0))
    before, output = net.state_dict(), net(x)
    parameters = list(net.parameters())
    net = share_statistics(net, "cpu")
    assert sum(isinstance(part, JointBatchNorm2d) for part in net.modules()) == 2
    assert all(a is b for a, b in zip(net.parameters(), parameters, strict=True))
    assert net.state_dict().keys() == before.keys()
    assert torch.equal(net(x), output)
    assert share_statistics(net, "cpu")[1][0] is net[1][0]  # twice is once


def test_on_gpus_the_norms_are_those_of_pytorch() -> None:
    net = make_net()
    before = net.state_dict()
    parameters = list(net.parameters())
    net = share_statistics(net, "cuda")  # moved there only afterwards
    assert sum(isinstance(part, nn.SyncBatchNorm) for part in net.modules()) == 2
    assert not any(isinstance(part, nn.BatchNorm2d) for part in net.modules())
    assert all(a is b for a, b in zip(net.parameters(), parameters, strict=True))
    assert net.state_dict().keys() == before.keys()
