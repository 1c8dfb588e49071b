"""Sizes of image, network and run that two cores train in 20 minutes; presets of all tasks."""

from lss_core.config import DepthBins, ImageConfig, ModelConfig
from lss_core.grid import BevGrid
from shoot.training.config import OptimConfig

CPU_IMAGE = ImageConfig(
    height_px=64,
    width_px=176,
    resize=(1.0, 1.0),
    crop_bottom=(0.11, 0.11),
    rotate_rad=0.0,
    flip=False,
)
CPU_MODEL = ModelConfig(
    backbone="plain-16-32-64-128",
    pretrained="none",
    context_channels=32,
    image_stride=8,
    neck_channels=64,
    stem_channels=24,
    decoder_channels=48,
    depth=DepthBins(min_m=4.0, max_m=46.0, step_m=2.0),
    grid=BevGrid(x_min_m=-10.0, x_max_m=70.0, y_min_m=-32.0, y_max_m=32.0, cell_m=1.0),
)
CPU_OPTIM = OptimConfig(
    steps=5600, batch_size=8, learning_rate=2e-3, warmup_steps=100, schedule="cosine"
)
