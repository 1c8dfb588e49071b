"""Sensors made worse when a run is asked, as in the paper's section 5.3: noise, dead cameras."""

from dataclasses import dataclass, replace
from typing import Annotated

import torch

from lss_core.batch import Batch
from lss_core.bounds import Bounds, check_settings
from lss_core.config import DataConfig
from lss_core.errors import DataError


@dataclass(frozen=True)
class Disturbance:
    """What is done to a sample's cameras; nothing by default.

    What is random follows from the run's seed and the sample's position in the split alone: all
    runs of a seed meet the same.

    Attributes:
        noise_rad: Standard deviation of rotation noise on `ego_from_camera`, about each axis.
        noise_m: Standard deviation of translation noise on it, along each axis.
        drop_cameras: Cameras hidden at random in each sample, fewer than there are.
        missing: Channels hidden in all samples.
    """

    noise_rad: Annotated[float, Bounds(0.0, 3.2)] = 0.0
    noise_m: Annotated[float, Bounds(0.0, 100.0)] = 0.0
    drop_cameras: Annotated[int, Bounds(0, 1_000)] = 0
    missing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def is_random(self) -> bool:
        """Whether samples must be drawn, as in training."""
        return bool(self.noise_rad or self.noise_m or self.drop_cameras)

    def of_data(self, data: DataConfig) -> DataConfig:
        """What a data set is to do when samples are drawn: this, and no augmentation."""
        image = data.image
        lowest, highest = image.crop_bottom
        middle = (lowest + highest) / 2.0
        return replace(
            data,
            image=replace(
                image,
                resize=(1.0, 1.0),
                crop_bottom=(middle, middle),
                rotate_rad=0.0,
                flip=False,
            ),
            extrinsic_noise_rad=self.noise_rad,
            extrinsic_noise_m=self.noise_m,
            drop_cameras=self.drop_cameras,
        )

    def hide(self, sensors: Batch, cameras: tuple[str, ...]) -> Batch:
        """The same without the missing cameras.

        Args:
            sensors: A batch.
            cameras: Names of its N cameras.

        Raises:
            DataError: If one of the missing is none of these.
        """
        unknown = sorted(set(self.missing) - set(cameras))
        if unknown:
            raise DataError(
                f"{unknown[0]} is none of the run's cameras, {', '.join(cameras)}; hide one of "
                "these."
            )
        if not self.missing:
            return sensors
        kept = torch.tensor([name not in self.missing for name in cameras])
        return replace(sensors, camera_mask=sensors.camera_mask & kept)


UNDISTURBED = Disturbance()
