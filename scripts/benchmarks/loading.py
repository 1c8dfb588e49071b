"""Samples from 1600 x 900 JPEGs on one core, and the memory of loader workers."""

import os
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor
from torch.utils.data import DataLoader, Dataset

from benchmarks.measuring import seconds
from lss_core.config import CAMERAS, DataConfig
from lss_core.data.dataset import CameraDataset, ego_from_camera
from lss_core.data.samples import SampleIndex, load_index
from lss_core.data.sensors.images import draw_pixel_map
from lss_core.image_encoder import IMAGENET_MEAN, IMAGENET_STD
from shoot.world.config import MakeWorldConfig
from shoot.world.writer import make_world

CONFIG = DataConfig()


def make_images(folder: Path) -> Path:
    """A few seconds of one synthetic scene, its images as large as nuScenes' own."""
    make_world(
        MakeWorldConfig(
            out=folder, train_scenes=1, val_scenes=0, image_scale=1.0, duration_s=7.0, workers=1
        )
    )
    return folder


def _dataset(root: Path, version: str) -> CameraDataset:
    index = load_index(root, version, CAMERAS)
    there = [
        row
        for row in range(len(index.sample_token))
        if index.has_camera[row].all()
        and all((root / path).is_file() for path in index.image_path[row])
    ]
    return CameraDataset(index, np.asarray(there), DataConfig(root=str(root), version=version))


def _one_after_the_other(load: Callable[[int], Tensor], num: int) -> Callable[[], Tensor]:
    torch.set_num_threads(1)
    turn: Iterator[int] = count()
    return lambda: load(next(turn) % num)


def _plain_images(dataset: CameraDataset, position: int) -> Tensor:
    """[N, 3, H, W] decoded whole, resized whole, cropped, made float and normalised."""
    row = int(dataset.rows[position])
    mean, std = (torch.tensor(v).view(3, 1, 1) for v in (IMAGENET_MEAN, IMAGENET_STD))
    images = []
    for path in dataset.index.image_path[row]:
        image = Image.open(dataset.root / path).convert("RGB")
        pixel_map = draw_pixel_map(CONFIG.image, (image.height, image.width), None)
        height, width = pixel_map.resized_hw
        left, top = pixel_map.left_px, pixel_map.top_px
        rows, columns = pixel_map.image_hw
        image = image.resize((width, height), Image.Resampling.BILINEAR)
        image = image.crop((left, top, left + columns, top + rows))
        pixels = torch.from_numpy(np.array(image)).permute(2, 0, 1).float() / 255.0
        images.append((pixels - mean) / std)
    return torch.stack(images)


def _fast_images(dataset: CameraDataset, position: int) -> Tensor:
    """[N, 3, H, W] bytes, as our network takes them, from a whole item with its matrices."""
    return dataset[position, -1].images


def _normalised(images: Tensor) -> Tensor:
    """What our network makes of bytes before its first layer."""
    mean, std = (torch.tensor(v).view(3, 1, 1) for v in (IMAGENET_MEAN, IMAGENET_STD))
    return (images.float() / 255.0 - mean) / std


def plain_load(root: Path, version: str) -> Callable[[], Tensor]:
    """One sample's images the straightforward way."""
    dataset = _dataset(root, version)
    return _one_after_the_other(partial(_plain_images, dataset), len(dataset))


def fast_load(root: Path, version: str) -> Callable[[], Tensor]:
    """One sample by `CameraDataset`."""
    dataset = _dataset(root, version)
    return _one_after_the_other(partial(_fast_images, dataset), len(dataset))


def difference(root: Path, version: str) -> NDArray[np.float64]:
    """How far the two ways' pixels are apart, of 255 levels, over all samples."""
    dataset = _dataset(root, version)
    std = torch.tensor(IMAGENET_STD).view(3, 1, 1)
    parts = [
        (_plain_images(dataset, i) - _normalised(_fast_images(dataset, i))).mul(std).abs() * 255.0
        for i in range(len(dataset))
    ]
    return torch.cat(parts).flatten().double().numpy()


def normalising_s(root: Path, version: str) -> float:
    """Seconds a sample that turning bytes into floats costs the network, not the loader."""
    torch.set_num_threads(1)
    images = _fast_images(_dataset(root, version), 0)
    _normalised(images)
    return seconds(lambda: _normalised(images), 20)


class _PoseDataset(Dataset[Tensor]):
    """Reads what an item needs of the index; images play no part."""

    def __init__(self, index: SampleIndex) -> None:
        self.index = index

    def __len__(self) -> int:
        return len(self.index.sample_token)

    def __getitem__(self, row: int) -> Tensor:
        _ = [str(path) for path in self.index.image_path[row]]
        return torch.from_numpy(ego_from_camera(self.index, row))


def workers_mb(root: Path, version: str, num_workers: int) -> Callable[[], float]:
    """Memory (10^6 bytes) of a process and its loader workers after each has read many samples.

    Pages that several processes share count once.
    """
    index = load_index(root, version, CAMERAS)

    def run() -> float:
        loader = DataLoader(
            _PoseDataset(index),
            batch_size=64,
            num_workers=num_workers,
            persistent_workers=True,
            multiprocessing_context="fork",  # as in a command; here the default is another
        )
        batches = iter(loader)
        for _ in range(20 * num_workers):
            next(batches)
        children = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
        return sum(_proportional_mb(pid) for pid in ["self", *children])

    return run


def _proportional_mb(pid: str) -> float:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) * 1024 / 1e6
    return 0.0
