"""Backbones at both strides, weights from where they are said to be, errors that say what to do."""

from pathlib import Path

import pytest
import safetensors.torch
import timm
import torch
from timm.data import IMAGENET_DEFAULT_MEAN
from torch import nn

from lss_core.errors import DataError
from lss_core.image_encoder import ImageEncoder, create_backbone

pytestmark = pytest.mark.trains


def _encoder(backbone: str = "plain-8-12-16-20", stride: int = 16, seed: int = 0) -> ImageEncoder:
    torch.manual_seed(seed)
    return ImageEncoder(backbone, "none", 5, 7, stride, neck_channels=8).eval()


@pytest.mark.parametrize(
    ("backbone", "stride"),
    [
        ("plain-8-12-16-20", 16),
        ("plain-8-12-16", 8),
        ("resnet10t", 8),
        ("resnet10t", 16),
        ("efficientnet_b0", 8),
        ("efficientnet_b0", 16),
        ("mobilenetv3_small_050", 16),
    ],
)
def test_every_feature_cell_has_a_context_and_a_distribution(backbone: str, stride: int) -> None:
    encoder = _encoder(backbone, stride)
    with torch.no_grad():
        context, depth_prob = encoder(torch.rand(2, 3, 64, 96))
    assert context.shape == (2, 7, 64 // stride, 96 // stride)
    assert depth_prob.shape == (2, 5, 64 // stride, 96 // stride)
    torch.testing.assert_close(depth_prob.sum(dim=1), torch.ones(2, 64 // stride, 96 // stride))
    assert depth_prob.std() > 0.0


@pytest.mark.parametrize(
    ("backbone", "stride"),
    [("efficientnet_b0", 16), ("efficientnet_b0", 8), ("resnet10t", 8), ("plain-8-12-16-20", 8)],
)
def test_nothing_is_carried_that_is_never_run(backbone: str, stride: int) -> None:
    encoder = _encoder(backbone, stride)
    context, depth_prob = encoder(torch.rand(1, 3, 64, 64))
    (context.square().sum() + depth_prob.square().sum()).backward()
    unused = [name for name, parameter in encoder.named_parameters() if parameter.grad is None]
    assert unused == []


def test_a_cell_and_its_features_are_at_the_same_place() -> None:
    # A bright spot in cell (4, 9) of 8 x 16 changes the features around that cell, whatever the
    # weights; half a cell is left to convolutions of stride 2, which look up and left.
    dark = torch.zeros(1, 3, 128, 256)
    spot = dark.clone()
    spot[..., 4 * 16 : 5 * 16, 9 * 16 : 10 * 16] = 1.0
    change = torch.zeros(8, 16)
    for seed in range(8):
        encoder = _encoder(seed=seed)
        with torch.no_grad():
            change += (encoder(spot)[0] - encoder(dark)[0]).abs().sum(dim=1)[0]
    row = (change.sum(dim=1) * torch.arange(8)).sum() / change.sum()
    column = (change.sum(dim=0) * torch.arange(16)).sum() / change.sum()
    assert float(row) == pytest.approx(4.25, abs=0.75)
    assert float(column) == pytest.approx(9.25, abs=0.75)


def test_images_are_normalised_as_the_backbone_was_trained() -> None:
    encoder = _encoder()
    seen: list[torch.Tensor] = []
    encoder.backbone.register_forward_pre_hook(lambda _, args: seen.append(args[0]))
    encoder(torch.tensor(IMAGENET_DEFAULT_MEAN).view(1, 3, 1, 1).expand(1, 3, 64, 64))
    torch.testing.assert_close(seen[0], torch.zeros(1, 3, 64, 64), atol=1e-6, rtol=0.0)
    # This one of timm's was trained on (x - 0.5) / 0.5.
    _, _, mean, std = create_backbone("mobilenetv3_large_150d", "none", 16)
    expected = timm.create_model("mobilenetv3_large_150d").pretrained_cfg
    assert (mean, std) == (tuple(expected["mean"]), tuple(expected["std"]))


@pytest.mark.parametrize("suffix", [".safetensors", ".pth"])
@pytest.mark.parametrize("name", ["resnet10t", "efficientnet_b0"])
def test_a_weights_file_of_the_whole_model_fills_the_backbone(
    tmp_path: Path, name: str, suffix: str
) -> None:
    torch.manual_seed(1)
    whole = timm.create_model(name, pretrained=False).eval()
    path = tmp_path / f"weights{suffix}"
    if suffix == ".safetensors":
        safetensors.torch.save_file(whole.state_dict(), path)
    else:
        torch.save({"state_dict": whole.state_dict()}, path)
    net, channels, _, _ = create_backbone(name, str(path), 16)
    images = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        fine, coarse = net.eval()(images)
        _, intermediates = whole.forward_intermediates(images)
    assert (fine.shape[1], coarse.shape[1]) == channels
    torch.testing.assert_close(coarse, intermediates[-1])
    torch.testing.assert_close(fine, intermediates[-2])


@pytest.mark.parametrize("name", ["plain-4-6-8", "efficientnet_b0"])
def test_the_weights_of_a_run_fill_the_backbone(tmp_path: Path, name: str) -> None:
    torch.manual_seed(1)
    trained, *_ = create_backbone(name, "none", 16)
    state = {f"model.image_encoder.backbone.{k}": v for k, v in trained.state_dict().items()}
    path = tmp_path / "weights.safetensors"
    safetensors.torch.save_file(state | {"planner.templates": torch.zeros(3)}, path)
    net, *_ = create_backbone(name, str(path), 16)
    for key, value in trained.state_dict().items():
        assert torch.equal(net.state_dict()[key], value), key


def _spoil(state: dict[str, torch.Tensor], how: str) -> object:
    if how == "lacks":
        del state["layer1.0.conv1.weight"]
    elif how == "unknown":
        state["module.layer1.weight"] = torch.zeros(1)
    elif how == "shapes":
        state["layer1.0.conv1.weight"] = torch.zeros(1, 1, 3, 3)
    elif how == "dictionary":
        return [1, 2, 3]
    return state


@pytest.mark.parametrize("how", ["lacks", "unknown", "shapes", "dictionary"])
def test_a_weights_file_that_does_not_fit_says_so(tmp_path: Path, how: str) -> None:
    state = timm.create_model("resnet10t", pretrained=False).state_dict()
    path = tmp_path / "weights.pth"
    torch.save(_spoil(state, how), path)
    with pytest.raises(DataError, match=how) as caught:
        create_backbone("resnet10t", str(path), 16)
    assert str(path) in str(caught.value)


def test_a_weights_file_that_is_absent_or_rubbish_says_so(tmp_path: Path) -> None:
    path = tmp_path / "weights.pth"
    with pytest.raises(DataError, match=r"No weights file at .*weights.pth"):
        create_backbone("resnet10t", str(path), 16)
    for name in ("weights.pth", "weights.safetensors"):
        (tmp_path / name).write_bytes(b"not weights")
        with pytest.raises(DataError, match="not a readable weights file"):
            create_backbone("resnet10t", str(tmp_path / name), 16)


def test_a_hub_that_cannot_be_reached_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # An address where nobody listens: the real path through timm and the hub's client.
    monkeypatch.setattr("huggingface_hub.constants.ENDPOINT", "http://127.0.0.1:9")
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    monkeypatch.setattr("huggingface_hub.file_download.HF_HUB_CACHE", str(tmp_path), raising=False)
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(DataError, match=r"could not be downloaded .*--model.pretrained none"):
        create_backbone("resnet10t", "timm", 16)


@pytest.mark.parametrize(
    ("backbone", "word"),
    [
        ("efficientnet_bo", "did you mean .*efficientnet_b"),
        ("qqqqqqqq", "not a model of timm"),
        ("plain-16", "three or four even widths"),
        ("plain-16-x-64", "three or four even widths"),
        ("plain-15-32-64", "three or four even widths"),
        ("vit_tiny_patch16_224", "strides|feature maps"),
    ],
)
def test_backbones_that_will_not_do_say_why(backbone: str, word: str) -> None:
    with pytest.raises(DataError, match=word):
        create_backbone(backbone, "none", 16)


def test_own_narrow_backbone_has_no_weights_to_download() -> None:
    with pytest.raises(DataError, match="no pretrained weights for backbone 'plain-8-12-16'"):
        create_backbone("plain-8-12-16", "timm", 8)


def test_the_paper_backbones_size() -> None:
    net, channels, _, _ = create_backbone("efficientnet_b0", "none", 16)
    # EfficientNet-B0 has 5,288,548 parameters, of which 1,693,160 sit in its classification head.
    assert sum(p.numel() for p in net.parameters()) == 5_288_548 - 1_693_160
    assert channels == (112, 320)
    assert not any(isinstance(module, nn.Linear) for module in net.modules())
