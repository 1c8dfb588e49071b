"""Nothing between images and gradients has the host wait for a GPU; found without one."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import fields, replace
from typing import Literal

import pytest
import torch
from host_waits import CONFIG, assert_no_host_wait, some_batch
from torch import Tensor

from lss_core.batch import Batch, collate
from lss_core.model import CameraModel
from shoot.planner import Planner


@pytest.mark.parametrize("frustum", ["cell", "released"])
@pytest.mark.parametrize("device", ["cpu", "meta"])
def test_no_wait_from_images_to_gradients(
    device: str, frustum: Literal["cell", "released"], monkeypatch: pytest.MonkeyPatch
) -> None:
    if device == "meta":  # which has no autocast, not even to switch off
        monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())
    torch.manual_seed(0)
    model = CameraModel(replace(CONFIG, frustum=frustum), (32, 64))
    model = model.to(device).train()
    planner = Planner(torch.randn(7, 5, 2), CONFIG.grid).to(device)
    on_host = some_batch()
    # On the CPU nobody waits for the mask; on its way to a GPU the batch learns that it is full.
    sensors = on_host.to("meta")
    if device == "cpu":
        sensors = on_host
        object.__setattr__(sensors, "every_camera", True)
    labels = torch.zeros(2, dtype=torch.long, device=device)

    def step() -> None:
        planner.loss(planner(model.forward_batch(sensors)[:, 0]), labels).backward()

    assert_no_host_wait(step)


@pytest.mark.parametrize(
    "wait",
    [
        lambda x: bool((x > 0.0).all()),
        lambda x: x[x > 0.0],
        lambda x: (x > 0.0).nonzero(),
        lambda x: torch.linalg.inv(torch.diag(x)),
        lambda x: torch.bincount((x > 0.0).long()),
        lambda x: x.new_tensor([1.0, 2.0]),
        lambda x: torch.as_tensor((1.0, 2.0), device=x.device),
    ],
)
def test_waits_are_found(wait: Callable[[Tensor], object]) -> None:
    with pytest.raises(AssertionError, match=r"wait|copied"):
        assert_no_host_wait(lambda: wait(torch.ones(3)))


def test_a_batch_on_a_gpu_knows_whether_its_mask_hides_a_camera() -> None:
    whole = some_batch()
    assert whole.to("meta").every_camera
    assert whole.to("meta").to("meta").every_camera
    hidden = replace(whole, camera_mask=torch.tensor([[True, True], [True, False]]))
    assert not hidden.to("meta").every_camera
    # What was known of one mask is not said of another.
    moved = whole.to("meta")
    assert not replace(moved, camera_mask=moved.camera_mask.clone()).every_camera
    names = [f.name for f in fields(Batch) if f.init and f.name != "points"]
    one = replace(whole, **{name: getattr(whole, name)[0] for name in names})
    assert collate([one, one]).to("meta").every_camera
