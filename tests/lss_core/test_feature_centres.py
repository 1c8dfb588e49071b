"""Where features look: known networks, what is measured, and what a run keeps of it."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from lss_core.camera import frustum_points
from lss_core.config import DepthBins, ModelConfig
from lss_core.feature_centres import first_feature_px
from lss_core.grid import BevGrid
from lss_core.image_encoder import ImageEncoder
from lss_core.model import CameraModel

CONFIG = ModelConfig(
    backbone="plain-8-12-16",
    pretrained="none",
    context_channels=4,
    image_stride=8,
    neck_channels=8,
    stem_channels=8,
    decoder_channels=8,
    depth=DepthBins(min_m=4.0, max_m=12.0, step_m=2.0),
    grid=BevGrid(x_min_m=-16.0, x_max_m=16.0, y_min_m=-16.0, y_max_m=16.0, cell_m=2.0),
)


class _Encoder(ImageEncoder):
    """One convolution of stride 4 in place of a backbone: where it looks can be worked out."""

    def __init__(self, kernel: int, padding: tuple[int, int]) -> None:
        nn.Module.__init__(self)
        self.register_buffer("mean", torch.zeros(1, 3, 1, 1))
        self.conv = nn.Conv2d(3, 2, kernel, stride=4, padding=padding)
        nn.init.constant_(self.conv.weight, 1.0)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        features = self.conv(images)
        return features, features


@pytest.mark.parametrize(
    ("kernel", "padding", "expected_uv"),
    # The middle of the window of cell (0, 0): (kernel - 1) / 2 - padding, in u and v.
    [(4, (0, 0), (1.5, 1.5)), (3, (1, 1), (0.0, 0.0)), (7, (1, 3), (0.0, 2.0))],
)
def test_it_finds_the_middle_of_what_a_cell_sees(
    kernel: int, padding: tuple[int, int], expected_uv: tuple[float, float]
) -> None:
    # padding is given as (rows, columns).
    assert first_feature_px(_Encoder(kernel, padding), 4) == pytest.approx(expected_uv, abs=1e-6)


@pytest.mark.parametrize("weight", [0.0, math.nan])
def test_a_network_that_nothing_moves_looks_at_the_centre(weight: float) -> None:
    encoder = _Encoder(3, (1, 1))
    nn.init.constant_(encoder.conv.weight, weight)
    assert first_feature_px(encoder, 4) == (1.5, 1.5)


def test_padding_on_all_sides_alike_looks_before_the_centre_padding_behind_looks_behind_it() -> (
    None
):
    torch.manual_seed(0)
    alike = ImageEncoder("plain-8-12-16", "none", 5, 7, 8, neck_channels=8)
    behind = ImageEncoder("tf_mobilenetv3_small_minimal_100", "none", 5, 7, 16, neck_channels=8)
    assert max(first_feature_px(alike, 8)) < (8 - 1) / 2 - 2.0
    assert min(first_feature_px(behind, 16)) > (16 - 1) / 2 + 1.0


def test_measuring_leaves_no_trace() -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder("plain-8-12-16", "none", 5, 7, 8, neck_channels=8).train()
    before = {name: value.clone() for name, value in encoder.state_dict().items()}
    chance = torch.random.get_rng_state()
    measured = first_feature_px(encoder, 8)
    assert encoder.training
    assert torch.equal(torch.random.get_rng_state(), chance)
    assert all(torch.equal(value, before[name]) for name, value in encoder.state_dict().items())
    assert all(parameter.grad is None for parameter in encoder.parameters())
    assert first_feature_px(encoder, 8) == measured


def test_features_are_put_where_the_network_was_found_to_look() -> None:
    torch.manual_seed(0)
    model = CameraModel(CONFIG, (32, 48))
    assert model.first_px is not None
    assert model.first_px.tolist() == pytest.approx(first_feature_px(model.image_encoder, 8))
    intrinsics = torch.tensor([[40.0, 0.0, 20.0], [0.0, 50.0, 10.0], [0.0, 0.0, 1.0]])
    points = frustum_points(
        (32, 48), 8, [4.0], intrinsics[None, None], torch.eye(4)[None, None], model.first_px
    )
    u_px, v_px = model.first_px.tolist()
    # Cell (row 3, column 5) at 4 m, in a camera whose frame is the ego's.
    expected_m = [4.0 * (5 * 8 + u_px - 20.0) / 40.0, 4.0 * (3 * 8 + v_px - 10.0) / 50.0, 4.0]
    assert points[0, 0, 0, 3, 5].tolist() == pytest.approx(expected_m, abs=1e-5)


def test_a_run_keeps_what_was_measured_at_its_start() -> None:
    torch.manual_seed(0)
    begun, opened = CameraModel(CONFIG, (32, 48)), CameraModel(CONFIG, (32, 48))
    assert begun.first_px is not None
    assert opened.first_px is not None
    assert not torch.equal(begun.first_px, opened.first_px)  # other first weights
    opened.load_state_dict(begun.state_dict())
    assert torch.equal(begun.first_px, opened.first_px)
    others = CameraModel(replace(CONFIG, frustum="cell"), (32, 48))
    assert "first_px" not in others.state_dict()
