"""shoot-plan: one moment from your own cameras: ranked trajectories, a picture; or a video."""

import json
import logging
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from lss_core.bounds import Bounds, Count, SettingError, check_settings
from lss_core.errors import DataError
from lss_core.files import check_writable, write_atomically
from lss_core.legible import legible
from lss_core.progress import progress
from lss_core.strict_json import save_json
from shoot.cli.app import run
from shoot.moment.example import RIG_FILE, SPEED_MPS, write_example
from shoot.moment.planning import Moment, describe_plan, plan_moment, strange_lenses
from shoot.moment.rig_file import Rig, read_rig
from shoot.moment.showing import draw_plan, format_plan
from shoot.moment.stream import Stream, as_pixels, find_frames
from shoot.prediction.plain import PlainRun, open_plain
from shoot.prediction.shipped import NO_PLANNER_FOR_ROADS, shipped_run
from shoot.rendering.saving import picture_kind, save_figure

logger = logging.getLogger(__name__)

_SHOWN = 10


@dataclass(frozen=True)
class PlanConfig:
    """Rank trajectories by what the cameras of any calibrated rig see.

    Start with --example DIR, which writes a rig file, six images and the command to call next.

    Attributes:
        rig: The rig file: per camera its name, size of images, intrinsics and mounting.
        images: NAME=FILE of each camera; cameras of the rig without an image are left out.
        stream: In place of images, a folder with one folder per camera, NAME/0001.jpg and so on:
            each number that all cameras have is planned.
        speed_mps: How fast the car drives. It moves cameras that fire at different times (delay_s
            in the rig file), and planners tell it from that; at 0 the car seems to stand.
        run: Run folder of a planner; the shipped one, trained on a synthetic city, if not given.
        out: What is planned, as JSON; of a stream one line a frame.
        picture: The picture; of a stream the video, which needs PyAV (`pip install
            'shoot-planner[video]'`).
        top: How many templates are written, the most probable first.
        rate_hz: Frames a second of a stream's video.
        example: Write an example into this folder, and do nothing else.
    """

    rig: Path | None = None
    images: tuple[str, ...] = ()
    stream: Path | None = None
    speed_mps: Annotated[float, Bounds(-50.0, 100.0)] = 0.0
    run: Path | None = None
    out: Path | None = None
    picture: Path | None = None
    top: Count = 20
    rate_hz: Annotated[int, Bounds(1, 120)] = 10
    example: Path | None = None

    def __post_init__(self) -> None:
        check_settings(self)
        if self.example is not None:
            return
        if self.rig is None:
            raise SettingError("rig is missing: name a rig file, or begin with --example DIR.")
        if bool(self.images) == (self.stream is not None):
            raise SettingError("images or stream must be given, and not both.")


def plan(config: PlanConfig) -> None:
    """Plan, print the table and save what was planned with its picture.

    Raises:
        DataError: If rig, images or run are not as they should be.
        OSError: If a file cannot be written.
    """
    if config.example is not None:
        _write_example(config.example)
        return
    assert config.rig is not None
    rig = read_rig(config.rig)
    for sentence in rig.oddities:
        logger.warning(sentence)
    paths = _named(config.images)
    stream = None if config.stream is None else find_frames(config.stream, rig, config.speed_mps)
    opened = open_plain(config.run or shipped_run())
    if config.run is None:
        logger.warning(NO_PLANNER_FOR_ROADS)
    if stream is not None:
        _plan_stream(config, rig, stream, opened)
    else:
        _plan_one(config, rig, paths, opened)


def _plan_one(config: PlanConfig, rig: Rig, paths: dict[str, Path], opened: PlainRun) -> None:
    out, picture = config.out or Path("plan.json"), config.picture or Path("plan.png")
    check_writable(out)
    check_writable(picture)
    picture_kind(picture)
    moment = Moment.of(rig, paths, config.speed_mps)
    _warn(rig, moment, opened)
    planned = plan_moment(opened, moment)
    print(format_plan(opened, planned, min(config.top, _SHOWN)))
    save_json(describe_plan(opened, moment, planned, config.top, _note(config)), out)
    title = f"Planned from {len(moment.cameras)} cameras"
    save_figure(draw_plan(opened, moment, planned, title, _caption(config)), picture, dpi=110.0)
    print(f"Plan:    {out}\nPicture: {picture}")


def _plan_stream(config: PlanConfig, rig: Rig, stream: Stream, opened: PlainRun) -> None:
    # What draws and encodes films takes seconds to load, and is for this only.
    from shoot.simulation.filming.video import import_av, write_video

    out, video = config.out or Path("plan.jsonl"), config.picture or Path("plan.mp4")
    import_av()
    check_writable(out)
    check_writable(video)
    if stream.num_incomplete:
        logger.warning("Frames that not all cameras have, left out: %d.", stream.num_incomplete)
    _warn(rig, stream.moments[0], opened)
    lines: list[str] = []

    def frames() -> Iterator[NDArray[np.uint8]]:
        with progress("Planning frames", len(stream.moments)) as advance:
            for number, moment in zip(stream.numbers, stream.moments, strict=True):
                planned = plan_moment(opened, moment)
                told = describe_plan(opened, moment, planned, config.top, _note(config))
                lines.append(json.dumps({"number": number, **told}, allow_nan=False) + "\n")
                title = f"Frame {number}"
                yield as_pixels(draw_plan(opened, moment, planned, title, _caption(config)))
                advance(1)

    write_video(frames(), video, config.rate_hz)
    with write_atomically(out) as file:
        file.write("".join(lines).encode())
    print(f"Frames:  {len(lines)}\nPlans:   {out}\nVideo:   {video}")


def _warn(rig: Rig, moment: Moment, opened: PlainRun) -> None:
    seen = {camera.name for camera in moment.cameras}
    left_out = [camera.name for camera in rig.cameras if camera.name not in seen]
    if left_out:
        logger.warning("Cameras of the rig without an image: %s.", ", ".join(left_out))
    for sentence in strange_lenses(opened, moment):
        logger.warning(sentence)


def _note(config: PlanConfig) -> str | None:
    return NO_PLANNER_FOR_ROADS if config.run is None else None


def _caption(config: PlanConfig) -> str:
    return _note(config) or legible(f"planner: {config.run}")


def _named(images: tuple[str, ...]) -> dict[str, Path]:
    paths: dict[str, Path] = {}
    for image in images:
        name, equals, path = image.partition("=")
        if not (name and equals and path):
            raise DataError(f"'{image}' is no NAME=FILE, as FRONT=front.jpg.")
        if name in paths:
            raise DataError(f"There are two images of '{name}'; give one of each camera.")
        paths[name] = Path(path)
    return paths


def _write_example(folder: Path) -> None:
    images = write_example(folder)
    words = ["shoot-plan", "--rig", str(folder / RIG_FILE), "--images"]
    words += [f"{name}={path}" for name, path in images.items()]
    words += [
        "--speed-mps",
        f"{SPEED_MPS:.1f}",
        "--out",
        str(folder / "plan.json"),
        "--picture",
        str(folder / "plan.png"),
    ]
    print(f"Rig and images: {folder}. Next:\n\n{shlex.join(words)}")


def main() -> None:
    """Entry point of `shoot-plan`."""
    run(PlanConfig, plan, "Plan from the images of your own cameras.")
