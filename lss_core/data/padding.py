"""How much of what the network sees of each camera comes from no image."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.config import DataConfig, ImageConfig
from lss_core.data.dataset import raw_hw
from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.images import draw_pixel_map, upright_map
from lss_core.errors import DataError
from lss_core.legible import legible

logger = logging.getLogger(__name__)

_MOST = 0.25
# Of each range that training draws from.
_DRAWS = 5


def padding(image: ImageConfig, raw_hw: tuple[int, int], training: bool = False) -> float:
    """Share of the network's image that is black since the file has nothing there.

    Where the horizon lies does not matter: no crop is moved out of the image for it. Nor does what
    turning adds.

    Args:
        image: What is done to images.
        raw_hw: Size of the image file.
        training: On average over what training draws, instead of what evaluation takes.
    """
    if not training:
        return draw_pixel_map(image, raw_hw, None).padding
    shares = [
        upright_map(image, raw_hw, factor, bottom).padding
        for factor in np.linspace(*image.resize, _DRAWS).tolist()
        for bottom in np.linspace(*image.crop_bottom, _DRAWS).tolist()
    ]
    return sum(shares) / len(shares)


def check_padding(
    index: SampleIndex, config: DataConfig, rows: NDArray[np.int64], training: bool = False
) -> None:
    """Log how much of what the network sees of some samples is black at most, if anything is.

    One look per camera and size of its images; those without a size in the tables count as large as
    the first of them.

    Args:
        index: Of the data set.
        config: Where it is, and what is done to images.
        rows: Samples.
        training: As in `padding`. The average, since each sample is drawn anew: paper's ranges pad
            a third of an image that is not higher than the network's in their last draws.

    Raises:
        DataError: If more than a quarter of a camera's images is.
    """
    image = config.image
    worst, where = 0.0, ""
    for n, camera in enumerate(index.cameras):
        own = rows[index.has_camera[rows, n]]
        _, first = np.unique(index.image_hw[own, n], axis=0, return_index=True)
        for row in own[first].tolist():
            height, width = raw_hw(index, Path(config.root), row, n)
            share = padding(image, (height, width), training)
            if share > worst:
                worst, where = share, f"{legible(str(camera))} ({width}x{height} px)"
    if not worst:
        return
    when = "training draws" if training else "the planner sees"
    said = f"{worst:.0%} of the {image.width_px}x{image.height_px} px that {when} of {where}"
    if worst > _MOST:
        raise DataError(
            f"{said} would be black, since the image ends before: at most {_MOST:.0%} may be. Set "
            f"--data.image.resize, now {image.resize[0]:g} {image.resize[1]:g}, to factors of the "
            "size at which images fill the network's (1 1: just so), and --data.image.crop-bottom, "
            f"now {image.crop_bottom[0]:g} {image.crop_bottom[1]:g}, to shares (0.11 for 11 %) "
            "that leave it enough rows."
        )
    logger.info("%s are black borders, at most.", said)
