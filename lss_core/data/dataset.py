"""One sample of the index -> one Batch item."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch.utils.data import Dataset

from lss_core.batch import Batch
from lss_core.camera import horizon_row
from lss_core.config import DataConfig
from lss_core.data.samples import SampleIndex
from lss_core.data.sensors.images import draw_pixel_map, load_image, open_image
from lss_core.data.sensors.lidar import load_scans
from lss_core.data.usable import Needs, check_row
from lss_core.errors import DataError
from lss_core.geometry import FloatArray, invert


def ego_from_camera(index: SampleIndex, row: int, ego_motion: bool = True) -> FloatArray:
    """[N, 4, 4] camera poses in the ego frame of the sample's lidar time.

    With `ego_motion` the car's own motion between a camera's shutter and the lidar's time stamp is
    undone: ego_from_global(t_lidar) . global_from_ego(t_camera) . mounting.

    Paper: silent. Deviation from the released code, see docs/deviations.md.
    """
    mounting: FloatArray = index.egocam_from_camera[row]
    if not ego_motion:
        return mounting
    ego_from_egocam: FloatArray = invert(index.global_from_ego[row]) @ index.global_from_egocam[row]
    return np.where(index.has_camera[row][:, None, None], ego_from_egocam @ mounting, mounting)


def raw_hw(index: SampleIndex, root: Path, row: int, camera: int) -> tuple[int, int]:
    """Height and width of an image: what the tables say, else what the file says.

    Raises:
        DataError: If the file is asked and cannot tell.
    """
    height, width = (int(side) for side in index.image_hw[row, camera])
    if height > 0 and width > 0:
        return height, width
    width, height = open_image(root / index.image_path[row, camera]).size
    return height, width


@contextmanager
def _naming(index: SampleIndex, row: int) -> Iterator[None]:
    """Say which sample it was."""
    try:
        yield
    except DataError as error:
        raise DataError(f"Sample {index.sample_token[row]}: {error.sentence}") from error


class CameraDataset(Dataset[Batch]):
    """Images and matrices of samples, augmented when an item is asked for with a draw number.

    An item is asked for as `(position, draw)`. Everything random about it follows from the seed and
    `draw` alone, so any number of workers and any restart give the same images. A negative draw
    means evaluation: no augmentation, no dropped cameras, no noise.

    Args:
        index: Of the data set.
        rows: Its samples.
        config: Which data, and what is done to it.
        seed: Of everything random.
        with_points: Give the keyframe's lidar points, too: a teacher of depth.
    """

    def __init__(
        self,
        index: SampleIndex,
        rows: NDArray[np.int64],
        config: DataConfig,
        seed: int = 0,
        with_points: bool = False,
    ) -> None:
        self.index = index
        self.rows = rows
        self.config = config
        self.seed = seed
        self.with_points = with_points
        self.root = Path(config.root)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, item: tuple[int, int]) -> Batch:
        """The sample at a position, without batch dimension.

        Raises:
            DataError: If a record or a file of it cannot be used.
        """
        position, draw = item
        row = int(self.rows[position])
        check_row(self.index, row, Needs.of_planner(0, self.with_points))
        with _naming(self.index, row):
            return self._item(row, draw)

    def _item(self, row: int, draw: int) -> Batch:
        rng = np.random.default_rng((self.seed, draw)) if draw >= 0 else None
        num = len(self.index.cameras)
        size = self.config.image
        images = np.zeros((num, size.height_px, size.width_px, 3), dtype=np.uint8)
        pixel_from_camera = np.tile(np.eye(3), (num, 1, 1))
        mask = self._kept_cameras(row, rng)
        for n in range(num):
            is_there = self.index.has_camera[row, n]
            side_px = raw_hw(self.index, self.root, row, n) if is_there else (900, 1600)
            intrinsics = self.index.rawpixel_from_camera[row, n]
            # As the camera is mounted, so that all samples of a calibration are cropped alike.
            mounting = self.index.egocam_from_camera[row, n]
            horizon = horizon_row(intrinsics, mounting) if is_there else None
            # Drawn for every camera, so that a dropped one does not change the others.
            pixel_map = draw_pixel_map(size, side_px, rng, horizon)
            if not mask[n]:
                continue
            images[n] = load_image(self.root / self.index.image_path[row, n], pixel_map)
            pixel_from_camera[n] = pixel_map.pixel_from_rawpixel @ intrinsics
        poses = self._noisy(ego_from_camera(self.index, row, self.config.ego_motion), rng)
        points = np.zeros((0, 5), dtype=np.float32)
        if self.with_points:
            points = load_scans(self.index, self.root, row, 1)
        return Batch(
            images=torch.from_numpy(images).permute(0, 3, 1, 2),
            pixel_from_camera=torch.from_numpy(pixel_from_camera).float(),
            ego_from_camera=torch.from_numpy(poses.astype(np.float32)),
            camera_mask=torch.from_numpy(mask),
            sample_idx=torch.tensor(row),
            points=torch.from_numpy(points),
            point_counts=torch.tensor(len(points)),
        )

    def _kept_cameras(self, row: int, rng: np.random.Generator | None) -> NDArray[np.bool_]:
        """Which cameras are shown; at least one always is."""
        mask: NDArray[np.bool_] = self.index.has_camera[row].copy()
        if rng is not None and self.config.drop_cameras:
            there = np.flatnonzero(mask)
            dropped = min(self.config.drop_cameras, len(there) - 1)
            mask[rng.choice(there, size=max(dropped, 0), replace=False)] = False
        return mask

    def _noisy(self, poses: FloatArray, rng: np.random.Generator | None) -> FloatArray:
        """Calibration noise (paper, section 5.3)."""
        config = self.config
        if rng is None or not (config.extrinsic_noise_rad or config.extrinsic_noise_m):
            return poses
        num = len(poses)
        turn = Rotation.from_rotvec(rng.normal(0.0, config.extrinsic_noise_rad, (num, 3)))
        noisy = poses.copy()
        noisy[:, :3, :3] = poses[:, :3, :3] @ turn.as_matrix()
        noisy[:, :3, 3] += rng.normal(0.0, config.extrinsic_noise_m, (num, 3))
        return noisy


class LidarDataset(Dataset[Batch]):
    """Lidar scans of samples; nothing about them is random.

    Items are asked for as `(position, draw)`, as from `CameraDataset`.
    """

    def __init__(self, index: SampleIndex, rows: NDArray[np.int64], config: DataConfig) -> None:
        self.index = index
        self.rows = rows
        self.config = config

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, item: tuple[int, int]) -> Batch:
        """The sample at a position, without batch dimension.

        Raises:
            DataError: If a record or a file of it cannot be used.
        """
        row = int(self.rows[item[0]])
        check_row(self.index, row, Needs.of_planner(self.config.lidar_scans))
        with _naming(self.index, row):
            points = load_scans(self.index, Path(self.config.root), row, self.config.lidar_scans)
        return Batch(
            images=torch.zeros(0, 3, 1, 1),
            pixel_from_camera=torch.zeros(0, 3, 3),
            ego_from_camera=torch.zeros(0, 4, 4),
            camera_mask=torch.zeros(0, dtype=torch.bool),
            sample_idx=torch.tensor(row),
            points=torch.from_numpy(points),
            point_counts=torch.tensor(len(points)),
        )


def open_sensors(
    index: SampleIndex,
    rows: NDArray[np.int64],
    config: DataConfig,
    seed: int = 0,
    with_points: bool = False,
) -> CameraDataset | LidarDataset:
    """What a model of this data sees: images, or lidar scans.

    Args:
        index: Of the data set.
        rows: Its samples.
        config: Which data, and what is done to it.
        seed: Of everything random.
        with_points: Give the keyframe's lidar points beside images.
    """
    if config.lidar_scans:
        return LidarDataset(index, rows, config)
    return CameraDataset(index, rows, config, seed, with_points)
