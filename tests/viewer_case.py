"""A scene for the page that scrubs, of plain values: made by hand, and hostile if wanted."""

import base64
import io
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
from PIL import Image

from lss_core.grid import BevGrid
from shoot.report.viewer.page import render_viewer
from shoot.report.viewer.pictures import cost_picture, image_within, points_picture
from shoot.report.viewer.scene import CameraPlace, SeenImage, ViewedSample, ViewedScene

NUM_SAMPLES, NUM_TEMPLATES = 8, 24
GRID = BevGrid(-10.0, 60.0, -16.0, 16.0, 2.0)
# Of a level camera that looks ahead from 1.5 m above the origin: u is 0.5 - y / x, v is
# 0.5 + 1.5 / x.
AHEAD = [[0.5, -1.0, 0.0], [0.5, 0.0, 1.5], [1.0, 0.0, 0.0]]


def make_sample(number: int, has_images: bool = True) -> ViewedSample:
    """The driven template has rank 1, 2, 3 ...; of ten it is then not among."""
    generator = np.random.default_rng(number)
    image = generator.integers(0, 255, (36, 64, 3), dtype=np.uint8)
    cost_map = generator.normal(size=GRID.shape)
    scan_m = generator.uniform(-10.0, 10.0, (40, 3))
    rank = 2 * number + 1
    best = list(range(10))
    return ViewedSample(
        token=f"token-{number}",
        time_s=0.1 * number,
        pose=[float(number), 0.0, 0.0],
        images=[SeenImage(0, image_within(image, 10**6), AHEAD)] if has_images else [],
        cost=cost_picture(cost_map, -1.0, 1.0),
        points="" if has_images else points_picture(scan_m, GRID),
        boxes=[[[10.0, 4.0], [8.0, 4.0], [8.0, 2.0], [10.0, 2.0]]],
        driven=[[0.5 * step, 0.1] for step in range(1, 21)],
        best=best,
        probabilities=[0.2 / (place + 1) for place in best],
        label=rank - 1,
        label_probability=0.2 / rank,
        rank=rank,
        hit=float(rank <= 10),
    )


def make_scene(has_images: bool = True) -> ViewedScene:
    return ViewedScene(
        name="scene-0003",
        description="Made by hand",
        about=["Run small, checkpoint last."],
        cameras=[CameraPlace("front", 1, 2), CameraPlace("back", 2, 2)] if has_images else [],
        grid=[GRID.x_min_m, GRID.x_max_m, GRID.y_min_m, GRID.y_max_m],
        cost_range=[-1.0, 1.0],
        ego=[[3.1, 0.9], [-1.0, 0.9], [-1.0, -0.9], [3.1, -0.9]],
        road=[[[-20.0, 4.0], [60.0, 4.0]]],
        dt_s=0.25,
        num_templates=NUM_TEMPLATES,
        templates={
            str(number): [[0.1 * number * step, 0.5 * number] for step in range(1, 21)]
            for number in range(NUM_TEMPLATES)
        },
        samples=[make_sample(number, has_images) for number in range(NUM_SAMPLES)],
    )


def hostile_page(word: str) -> str:
    """A page with the same text in every place that text can come from."""
    scene = make_scene()
    return render_viewer(
        replace(
            scene,
            name=word,
            description=word,
            about=[word],
            cameras=[replace(camera, label=word) for camera in scene.cameras],
            samples=[replace(sample, token=word) for sample in scene.samples],
        )
    )


def data_of(page: str) -> Any:
    """What stands in a page as JSON."""
    (text,) = re.findall(r'<script type="application/json" id="scene">(.*?)</script>', page)
    return json.loads(text)


def decoded(text: str) -> Image.Image:
    """The picture that a page has as a text."""
    return Image.open(io.BytesIO(base64.b64decode(text.split(",")[1])))
