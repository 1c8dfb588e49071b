"""Draws the example that `shoot-plan --example` gives: one moment in a town, six cameras.

python scripts/ship_example.py templates/example-rig
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from lss_core.config import CAMERAS
from lss_core.files import write_atomically
from shoot.moment.example import RIG_FILE
from shoot.moment.rig_file import RigCamera
from shoot.moment.rig_text import format_rig
from shoot.simulation.senses import Senses, SensorSettings
from shoot.world.looks.scenery import ego_pose
from shoot.world.nuscenes.tiling import seed_of
from shoot.world.town.roads import make_town
from shoot.world.traffic.scenario import make_scenario

# A town of those that planners of this city are evaluated in, which no training has seen.
_SEED, _SPLIT, _SCENE = 0, "val", 5
_TIME_S, _IMAGE_SCALE = 4.4, 0.25
_DURATION_S = 20.0  # as of the scenes of a data set


@dataclass(frozen=True)
class ExampleConfig:
    """Where to.

    Attributes:
        out: Folder to write.
    """

    out: Annotated[Path, tyro.conf.Positional]


def draw_example(folder: Path) -> float:
    """Write the rig file and an image of each camera; returns how fast the car drives, in m/s."""
    town = make_town(seed_of(_SEED, _SPLIT, "town", _SCENE))
    seed = seed_of(_SEED, _SPLIT, "scene", _SCENE)
    recording = make_scenario(town, seed, _DURATION_S)
    car = SensorSettings(image_scale=_IMAGE_SCALE, cameras=CAMERAS)
    senses = Senses(town, seed, car, recording)
    cameras = []
    for mounted, view in zip(senses.cameras, senses.look(recording, _TIME_S).views, strict=True):
        with write_atomically(folder / f"{view.channel}.jpg") as stream:
            stream.write(view.jpeg)
        cameras.append(
            RigCamera(
                view.channel,
                view.image_hw,
                view.rawpixel_from_camera,
                view.egocam_from_camera,
                mounted.delay_s,
            )
        )
    with write_atomically(folder / RIG_FILE) as stream:
        stream.write(format_rig(cameras).encode())
    # A turn is of no account within the hundredths of a second that lie between cameras.
    now, before = (np.asarray(ego_pose(recording, _TIME_S - age_s)[:2]) for age_s in (0.0, 0.1))
    return float(np.linalg.norm(now - before)) / 0.1


def main() -> None:
    """Draw it, and say what stands in no file."""
    config = tyro.cli(ExampleConfig, description=__doc__)
    print(f"{config.out}; the car drives {draw_example(config.out):.1f} m/s")


if __name__ == "__main__":
    main()
