"""What is written of the synthetic city: settings, and the names of the files they decide."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from lss_core.bounds import Bounds, Seed, SettingError, Workers, check_settings
from shoot.world.sensing.rig_plans import LIDAR_PERIOD_S, RIG_PLANS, RigName

VERSION = "v1.0-trainval"
CARD = "world.json"
# Raise it whenever the same settings would give other bytes: a resumed run must not mix two worlds.
WORLD_FORMAT = 3
# As many as the official splits name.
MAX_TRAIN_SCENES, MAX_VAL_SCENES = 700, 150
IMAGE_SCALES = 0.05, 1.0
ImageScale = Annotated[float, Bounds(*IMAGE_SCALES)]


@dataclass(frozen=True)
class MakeWorldConfig:
    """What `shoot-make-world` writes, and where.

    Attributes:
        out: Folder of the data set.
        train_scenes: Scenes of the official `train` split (at most 700).
        val_scenes: Scenes of the official `val` split (at most 150), one town each.
        seed: The same seed gives the same bytes.
        rig: Whose car drives: with nuScenes' six cameras of 1600 x 900, or with the seven of
            1920 x 1080 of Lyft Level 5, one of which looks ahead through a long lens.
        image_scale: Size of the images as a share of the rig's.
        sweeps: Which lidar sweeps get files: those of keyframes, or all outside the tail (ten
            times as many; planners that read several scans need them).
        workers: Processes; changes nothing but the time it takes.
        dask: Address of a dask scheduler, as tcp://host:8786; its workers then make the scenes.
            They must see the folder under the same name.
        scenes_per_town: Training scenes that share a town.
        duration_s: Length of a scene.
        keyframe_s: Time between keyframes, on average (nuScenes: 0.5 s).
        tail_s: Time at the end of a scene whose keyframes have boxes and a sweep, but no images: it
            is the future of the keyframes before (nuScenes: 0 s).
        lidar_azimuths: Lidar firings a turn (32 beams each); 0 takes fewer for smaller images.
    """

    out: Annotated[Path, tyro.conf.Positional]
    train_scenes: Annotated[int, Bounds(0, MAX_TRAIN_SCENES)] = 40
    val_scenes: Annotated[int, Bounds(0, MAX_VAL_SCENES)] = 10
    seed: Seed = 0
    rig: RigName = "nuscenes"
    image_scale: ImageScale = 0.25
    sweeps: Literal["keyframes", "all"] = "keyframes"
    workers: Workers = 2
    dask: str | None = None
    scenes_per_town: Annotated[int, Bounds(1, MAX_TRAIN_SCENES)] = 1
    duration_s: Annotated[float, Bounds(0.5, 60.0)] = 20.0
    keyframe_s: Annotated[float, Bounds(0.2, 5.0)] = 0.5
    tail_s: Annotated[float, Bounds(0.0, 60.0)] = 0.0
    lidar_azimuths: Annotated[int, Bounds(0, 4096)] = 0

    def __post_init__(self) -> None:
        check_settings(self)
        shortest_s = (RIG_PLANS[self.rig].first_turn + 1) * LIDAR_PERIOD_S
        if self.tail_s > self.duration_s - shortest_s:
            raise SettingError(
                f"tail_s is {self.tail_s:g}, but must be {shortest_s:g} s less than duration_s, "
                f"{self.duration_s:g}, or shorter."
            )
        if self.train_scenes + self.val_scenes == 0:
            raise SettingError("train_scenes and val_scenes are both 0: nothing to write.")

    def card(self) -> dict[str, Any]:
        """The settings that decide what is written (where and how it is does not)."""
        settings = asdict(self)
        del settings["out"], settings["workers"], settings["dask"]
        if self.rig == "nuscenes":  # as on the cards of worlds from before there was a choice
            del settings["rig"]
        return {"world_format": WORLD_FORMAT, **settings}

    def azimuths(self) -> int:
        """Lidar firings a turn."""
        return self.lidar_azimuths or azimuths_for(self.image_scale)


def azimuths_for(image_scale: float) -> int:
    """Lidar firings a turn that go with a size of images."""
    return 1024 if image_scale >= 0.2 else 384
