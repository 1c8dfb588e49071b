"""A window of the map is the map's window, whatever the sizes."""

import pytest
import torch

from lss_core.bev_encoder import BevEncoder
from lss_core.grid import CellWindow

pytestmark = pytest.mark.trains


def _encoder() -> BevEncoder:
    torch.manual_seed(0)
    net = BevEncoder(4, 2, stem_channels=8, decoder_channels=8, head_init_std=0.5).double()
    for module in net.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            # Biases make zeros beyond a wrong border show.
            torch.nn.init.normal_(module.bias)
            torch.nn.init.uniform_(module.running_var, 0.5, 2.0)
    return net.eval()


@pytest.mark.parametrize("size", [(64, 48), (40, 56), (33, 48), (30, 21)])
@pytest.mark.parametrize(
    "window",
    [
        CellWindow(0, 30, 0, 20),
        CellWindow(29, 30, 20, 21),
        CellWindow(11, 24, 3, 20),
        CellWindow(12, 23, 0, 21),
        CellWindow(0, 1, 0, 1),
    ],
)
def test_a_window_equals_the_same_cells_of_the_whole_map(
    size: tuple[int, int], window: CellWindow
) -> None:
    net = _encoder()
    bev = torch.randn(2, 4, *size, dtype=torch.float64)
    with torch.no_grad():
        whole, part = net(bev), net(bev, window)
    assert part.shape[-2:] == window.shape
    expected = whole[..., window.x_start : window.x_stop, window.y_start : window.y_stop]
    torch.testing.assert_close(part, expected, rtol=1e-10, atol=1e-10)


def test_a_window_at_the_far_border() -> None:
    net = _encoder()
    bev = torch.randn(1, 4, 64, 48, dtype=torch.float64)
    with torch.no_grad():
        part = net(bev, CellWindow(40, 64, 30, 48))
        torch.testing.assert_close(part, net(bev)[..., 40:, 30:], rtol=1e-10, atol=1e-10)


def test_the_decoder_runs_on_less() -> None:
    net = _encoder()
    sizes: list[int] = []
    net.smooth.register_forward_hook(lambda _, inputs, __: sizes.append(inputs[0][0, 0].numel()))
    with torch.no_grad():
        net(torch.randn(1, 4, 64, 48, dtype=torch.float64), CellWindow(20, 30, 20, 30))
    assert sizes == [12 * 12]
