"""Images to context vectors and depth distributions, one of each per feature cell."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import timm
import torch
from huggingface_hub import get_hf_file_metadata, hf_hub_url, try_to_load_from_cache
from huggingface_hub.errors import EntryNotFoundError
from jaxtyping import Float
from timm.models._hub import HF_SAFE_WEIGHTS_NAME, HF_WEIGHTS_NAME
from timm.models.efficientnet import EfficientNetFeatures
from timm.models.mobilenetv3 import MobileNetV3Features
from torch import Tensor, nn

from lss_core.convolutions import suit_cpus
from lss_core.errors import DataError

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
_HUB_PATIENCE_S = 5.0
# Where the weights of a run keep their backbone.
_OF_RUNS = "model.image_encoder.backbone."


class ImageEncoder(nn.Module):
    """Context and depth of every feature cell of every image.

    The backbone's features at the wanted stride are joined with those of twice that stride
    (upsampled), two 3x3 convolutions mix them, one 1x1 convolution gives D depth scores and C
    context channels.

    Paper: sections 3.1 and 4.1 (EfficientNet-B0 at stride 16).

    Args:
        backbone: Name of a timm model with features at both strides, or `plain-16-32-64-128`: a
            ResNet of one basic block a stage with these widths, made for CPUs.
        pretrained: `timm`, `none`, or the path of a file with the timm model's weights.
        num_depths: D; 0 for models that have no use for depths.
        context_channels: C.
        stride: Pixels per feature cell.
        neck_channels: Width of the two 3x3 convolutions.
        learns_depth: False: each depth has probability 1 / D, whatever is seen.
        freezes_backbone: Whether the backbone stays as it is made: no gradients, and batch norms
            that normalise by the statistics they came with. Neck and head learn.

    Raises:
        DataError: If the backbone is unknown or has no such strides, or its weights cannot be had.
    """

    mean: Tensor
    std: Tensor
    learns_depth = True
    freezes_backbone = False

    def __init__(
        self,
        backbone: str,
        pretrained: str,
        num_depths: int,
        context_channels: int,
        stride: int = 16,
        neck_channels: int = 512,
        learns_depth: bool = True,
        freezes_backbone: bool = False,
    ) -> None:
        super().__init__()
        self.num_depths = num_depths
        self.learns_depth = learns_depth
        self.freezes_backbone = freezes_backbone
        self.backbone, (fine_channels, coarse_channels), mean, std = create_backbone(
            backbone, pretrained, stride
        )
        self.register_buffer("mean", torch.tensor(mean).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(std).view(1, 3, 1, 1), persistent=False)
        self.upsample = nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False)
        self.neck = nn.Sequential(
            nn.Conv2d(fine_channels + coarse_channels, neck_channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(neck_channels),
            nn.ReLU(inplace=True),
            nn.Conv2d(neck_channels, neck_channels, 3, padding=1, bias=False),
            nn.BatchNorm2d(neck_channels),
            nn.ReLU(inplace=True),
        )
        self.num_scores = num_depths if learns_depth else 0
        self.head = nn.Conv2d(neck_channels, self.num_scores + context_channels, 1)
        self.backbone.requires_grad_(not freezes_backbone)
        self.train()

    def train(self, mode: bool = True) -> "ImageEncoder":
        """Training mode, or not; a frozen backbone has none."""
        super().train(mode)
        if self.freezes_backbone:
            self.backbone.eval()
        return self

    def forward(
        self, images: Float[Tensor, "M 3 Hi Wi"]
    ) -> tuple[Float[Tensor, "M C H W"], Float[Tensor, "M D H W"]]:
        """Context vectors, and depth probabilities that sum to one over D.

        Args:
            images: RGB in 0..1.
        """
        fine, coarse = self.backbone((images - self.mean) / self.std)
        coarse = self.upsample(coarse)[..., : fine.shape[-2], : fine.shape[-1]]
        features = self.head(self.neck(torch.cat([fine, coarse], dim=1)))
        # Over the innermost dimension in memory: the splat reads a pixel's depths side by side.
        scores = features[:, : self.num_scores].permute(0, 2, 3, 1)
        if self.learns_depth:
            depth_prob = scores.softmax(dim=-1)
        else:
            shape = (*scores.shape[:3], self.num_depths)
            depth_prob = scores.new_full(shape, 1.0 / self.num_depths, dtype=torch.float32)
        return features[:, self.num_scores :], depth_prob.permute(0, 3, 1, 2)


def create_backbone(
    name: str, pretrained: str, stride: int
) -> tuple[nn.Module, tuple[int, int], tuple[float, ...], tuple[float, ...]]:
    """A backbone that gives features at `stride` and twice that, and runs nothing beyond.

    Returns:
        The module; its channels at both strides; mean and deviation of the RGB (0..1) it expects.

    Raises:
        DataError: If the name is unknown, the strides are not there, or the weights cannot be had.
    """
    timm_name, options = _timm_arguments(name)
    reductions = _feature_info(_create(timm_name, name, options)).reduction()
    wanted = (stride, 2 * stride)
    if any(reductions.count(r) != 1 for r in wanted):
        raise DataError(
            f"Backbone {name!r} has features at strides {reductions}, but strides {wanted[0]} and "
            f"{wanted[1]} are needed; choose another one (--model.backbone), such as 'resnet18'."
        )
    out_indices = tuple(reductions.index(r) for r in wanted)
    net = _create(timm_name, name, {**options, "out_indices": out_indices}, pretrained == "timm")
    if isinstance(net, (EfficientNetFeatures, MobileNetV3Features)):
        # timm's EfficientNets keep the stages nobody reads, its other networks do not.
        last_stage = max(info["stage"] for info in _feature_info(net).get_dicts())
        net.blocks = net.blocks[:last_stage]
    suit_cpus(net)
    channels = _feature_info(net).channels()
    if pretrained not in ("timm", "none"):
        _load_weights(net, _create(timm_name, name, options, features_only=False), Path(pretrained))
    normalisation = getattr(net, "pretrained_cfg", None) or {}
    mean = IMAGENET_MEAN if options else normalisation.get("mean", IMAGENET_MEAN)
    std = IMAGENET_STD if options else normalisation.get("std", IMAGENET_STD)
    return net, (channels[0], channels[1]), tuple(mean), tuple(std)


def _timm_arguments(name: str) -> tuple[str, dict[str, object]]:
    """The timm model behind a backbone's name, and what differs from timm's own."""
    if not name.startswith("plain-"):
        return name, {}
    try:
        widths = tuple(int(width) for width in name.split("-")[1:])
    except ValueError:
        widths = ()
    if len(widths) not in (3, 4) or any(width < 2 or width % 2 for width in widths):
        raise DataError(
            f"Backbone {name!r}: expected 'plain-' and three or four even widths, such as "
            "'plain-16-32-64-128'."
        )
    channels = widths if len(widths) == 4 else (*widths, widths[-1])
    return "resnet18", {
        "layers": (1, 1, 1, 1),
        "channels": channels,
        "stem_type": "deep",
        "stem_width": channels[0] // 2,
    }


def _create(
    timm_name: str,
    name: str,
    options: Mapping[str, object],
    pretrained: bool = False,
    features_only: bool = True,
) -> nn.Module:
    if not timm.is_model(timm_name):
        close = difflib.get_close_matches(name, timm.list_models(), n=3)
        hint = f"; did you mean {' or '.join(close)}?" if close else "; see timm.list_models()."
        raise DataError(f"Backbone {name!r} is not a model of timm {timm.__version__}{hint}")
    if pretrained and timm_name != name:
        raise DataError(
            f"There are no pretrained weights for backbone {name!r}; use --model.pretrained none."
        )
    try:
        if pretrained:
            _ask_hub(timm_name)
        net: nn.Module = timm.create_model(
            timm_name, pretrained=pretrained, features_only=features_only, **options
        )
    except Exception as error:  # the hub client raises a dozen kinds
        if pretrained:
            raise DataError(
                f"The pretrained weights of {name!r} could not be downloaded "
                f"({type(error).__name__}); use --model.pretrained none, or the path of a weights "
                "file."
            ) from error
        raise DataError(
            f"Backbone {name!r} gives no feature maps ({error}); choose another one "
            "(--model.backbone), such as 'resnet18'."
        ) from error
    return net


def _ask_hub(name: str) -> None:
    """Ask the hub once for a model's weights; its own client tries for minutes before it gives up.

    Raises:
        Exception: Of many kinds, if it does not answer in seconds and the weights are not here.
    """
    hub_id = getattr(timm.get_pretrained_cfg(name), "hf_hub_id", None)
    files = (HF_SAFE_WEIGHTS_NAME, HF_WEIGHTS_NAME)
    if hub_id is None or any(isinstance(try_to_load_from_cache(hub_id, f), str) for f in files):
        return
    try:
        get_hf_file_metadata(hf_hub_url(hub_id, files[0]), timeout=_HUB_PATIENCE_S)
    except EntryNotFoundError:
        return  # it has answered; timm knows other names of the file


def _feature_info(net: nn.Module) -> Any:
    """What timm knows about the feature maps of a backbone."""
    return net.feature_info


def _load_weights(net: nn.Module, whole_model: nn.Module, path: Path) -> None:
    """Fill the backbone from a weights file of the whole timm model, or of a run of ours.

    Of a timm model the head is not needed, of a run nothing but its image backbone.
    """
    if not path.is_file():
        raise DataError(
            f"No weights file at {path}; give --model.pretrained timm, none, or an existing file."
        )
    try:
        state: Any
        if path.suffix == ".safetensors":
            state = safetensors.torch.load_file(path)
        else:
            state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # unpickling rubbish raises anything
        raise DataError(f"{path} is not a readable weights file ({error}).") from error
    if isinstance(state, dict) and isinstance(state.get("state_dict"), dict):
        state = state["state_dict"]
    if not isinstance(state, dict) or not all(isinstance(v, Tensor) for v in state.values()):
        raise DataError(f"{path} does not hold a dictionary of tensors.")
    of_run = {
        key.removeprefix(_OF_RUNS): value
        for key, value in state.items()
        if key.startswith(_OF_RUNS)
    }
    state = of_run or state
    own = net.state_dict()
    missing = [key for key in own if key not in state]
    odd = [key for key in state if key not in own and key not in whole_model.state_dict()]
    shape = [key for key in own if key in state and own[key].shape != state[key].shape]
    for problem, keys in (("lacks", missing), ("has unknown", odd), ("has other shapes of", shape)):
        if keys:
            raise DataError(
                f"{path} does not fit the backbone: it {problem} {len(keys)} of its weights, first "
                f"{keys[0]!r}. Give a file saved from the same timm model, or the weights of a run "
                "with this backbone."
            )
    net.load_state_dict({key: state[key] for key in own})
