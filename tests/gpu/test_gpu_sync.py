"""Between a batch on the GPU and its gradients the host never waits."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import torch
from host_waits import CONFIG, some_batch

from lss_core.model import CameraModel
from shoot.planner import Planner


@contextmanager
def _waiting_is_an_error() -> Iterator[None]:
    torch.cuda.set_sync_debug_mode("error")
    try:
        yield
    finally:
        torch.cuda.set_sync_debug_mode("default")


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_no_wait_from_images_to_gradients(precision: str) -> None:
    torch.manual_seed(0)
    model = CameraModel(CONFIG, (32, 64)).cuda().train()
    planner = Planner(torch.randn(7, 5, 2), CONFIG.grid).cuda()
    on_host = some_batch().pin_memory()
    labels = torch.zeros(2, dtype=torch.long, device="cuda")

    def step() -> None:
        sensors = on_host.to("cuda", non_blocking=True)
        with torch.autocast("cuda", torch.bfloat16, enabled=precision == "bf16-mixed"):
            loss = planner.loss(planner(model.forward_batch(sensors)[:, 0]), labels)
        loss.backward()

    step()  # sets libraries up
    torch.cuda.synchronize()
    with _waiting_is_an_error():
        step()
    assert all(p.grad is None or bool(p.grad.isfinite().all()) for p in model.parameters())


def test_a_wait_is_found() -> None:
    mask = torch.ones(3, device="cuda", dtype=torch.bool)
    with pytest.raises(RuntimeError, match="synchroniz"), _waiting_is_an_error():
        bool(mask.all())
