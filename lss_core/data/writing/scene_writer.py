"""One scene of a data set in the making, and what cannot be added to it."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lss_core.data.checks.recording import (
    Numbers,
    check_camera,
    check_poses,
    check_size,
    check_transforms,
    to_array,
    to_us,
)
from lss_core.data.sensors.file_checks import image_problem, sweep_problem
from lss_core.data.sensors.sweep_cuts import SceneSweeps
from lss_core.data.tables.file_names import is_plain
from lss_core.data.writing.placed_files import place_bytes, place_file
from lss_core.data.writing.scene_rows import LIDAR, POSES, Box, Frame, Mounting, Recording
from lss_core.errors import DataError
from lss_core.geometry import FloatArray

# Bytes of a name: names of files are made of two.
_LONGEST_NAME = 100


class SceneWriter:
    """A scene that sensors, keyframes, sweeps and boxes are added to; `TablesWriter` makes it.

    Times are seconds since an origin of your choice, the same for all of a scene. The ego frame is
    x forward, y left, z up, with its origin on the ground, best under the rear axle.

    Attributes:
        name: Of the scene.
        recording: What was added so far.

    Args:
        root: Folder of the data set.
        name: Of the scene.
        time_s: [P] of its poses, increasing.
        global_from_ego: [P, 4, 4] the car at these times, metres.

    Raises:
        DataError: If it is not as described; the methods' errors are the same.
    """

    def __init__(self, root: Path, name: str, time_s: Numbers, global_from_ego: Numbers) -> None:
        self.name = check_name(name, "scene")
        self._root = root
        what = f"Scene '{name}': poses"
        time_us = to_us(time_s, f"Scene '{name}': times of poses")
        poses = to_array(global_from_ego, (len(time_us), 4, 4), what)
        check_poses(time_us, poses, what)
        self.recording = Recording(name, time_us, poses)

    def add_camera(
        self,
        channel: str,
        rawpixel_from_camera: Numbers,
        ego_from_camera: Numbers,
        image_hw: tuple[int, int],
    ) -> None:
        """Mount a camera, an undistorted pinhole.

        Args:
            channel: Its name, as `CAM_FRONT`.
            rawpixel_from_camera: [3, 3] intrinsics; (0, 0) is the centre of the upper left pixel.
            ego_from_camera: [4, 4] mounting; the camera's x points right, y down, z forward.
            image_hw: Height and width of its images.
        """
        what = f"Camera '{channel}' of scene '{self.name}'"
        if channel in (LIDAR, POSES):
            raise DataError(f"{what} must have another name, which is not that of a camera.")
        matrix = to_array(rawpixel_from_camera, (3, 3), f"{what}: rawpixel_from_camera")
        size = check_size(image_hw, what)
        pose = self._pose(ego_from_camera, what)
        check_camera(matrix, pose, size, what)
        self._mount(channel, Mounting(pose, matrix, size), what)

    def add_lidar(self, ego_from_lidar: Numbers) -> None:
        """Mount a lidar [4, 4]; poses of its sweeps are then the scene's path: add all of them."""
        what = f"The lidar of scene '{self.name}'"
        if self.recording.keyframes_us:
            raise DataError(f"{what} must be added before the first keyframe.")
        self._mount(LIDAR, Mounting(self._pose(ego_from_lidar, what)), what)

    def add_keyframe(
        self,
        time_s: float,
        images: Mapping[str, str | Path],
        image_time_s: Mapping[str, float] | None = None,
        sweep: str | Path | Numbers | None = None,
    ) -> None:
        """Add a sample: a moment with an image of some or all cameras.

        Args:
            time_s: Of the ego frame, and of the sweep; later than the keyframe before.
            images: Files, JPEG or PNG, by channel. They are linked into the data set, or copied
                where this cannot be; those inside it stay where they are.
            image_time_s: When each was taken, if not at `time_s`.
            sweep: Of the lidar, which every keyframe has if the scene has one; see `add_sweep`.
        """
        time_us = self._moment(time_s, "keyframe")
        recording, what = self.recording, f"The keyframe at {time_s:.6f} s of scene '{self.name}'"
        if recording.keyframes_us and time_us <= recording.keyframes_us[-1]:
            before_s = recording.keyframes_us[-1] / 1e6
            raise DataError(f"{what} does not follow the one before, at {before_s:.6f} s.")
        if not images and sweep is None:
            raise DataError(f"{what} has neither image nor sweep.")
        times_s = image_time_s or {}
        cameras = [channel for channel in recording.mountings if channel != LIDAR]
        unknown = [channel for channel in (*images, *times_s) if channel not in cameras]
        if unknown:
            known = ", ".join(cameras) or "none"
            raise DataError(f"{what} has an unknown camera '{unknown[0]}'; known are {known}.")
        if (sweep is None) == (LIDAR in recording.mountings):
            raise DataError(f"{what} must have a sweep if the scene has a lidar, and only then.")
        number = len(recording.keyframes_us)
        frames = [
            self._image(channel, Path(file), times_s.get(channel, time_s), number)
            for channel, file in images.items()
        ]
        if sweep is not None:
            frames.append(self._sweep(time_us, sweep, number))
        recording.keyframes_us.append(time_us)
        recording.frames |= {(frame.channel, frame.time_us): frame for frame in frames}

    def add_sweep(self, time_s: float, sweep: str | Path | Numbers) -> None:
        """Add a sweep of the lidar between keyframes.

        Args:
            time_s: Its time.
            sweep: File in nuScenes' layout (five float32 a point: x, y, z, intensity, ring), or
                points [P, 4 or 5] of the same, in metres in the lidar's frame, intensity 0 to 255.
        """
        time_us = self._moment(time_s, "sweep")
        if LIDAR not in self.recording.mountings:
            raise DataError(f"Scene '{self.name}' has no lidar; call add_lidar before add_sweep.")
        self.recording.frames[LIDAR, time_us] = self._sweep(time_us, sweep, None)

    def add_box(
        self,
        time_s: float,
        instance: str,
        category: str,
        size_m: Numbers,
        global_from_box: Numbers,
    ) -> None:
        """Add an object's box at a keyframe.

        Args:
            time_s: Of the keyframe.
            instance: Name of the object, the same at all keyframes of the scene.
            category: Its kind, one per object; nuScenes' begin with `vehicle.` and `human.`, and
                collisions are counted with these alone.
            size_m: [3] length, width and height.
            global_from_box: [4, 4] the box's centre; x along its length.
        """
        time_us = self._moment(time_s, "box")
        what = f"The box of '{instance}' at {time_s:.6f} s of scene '{self.name}'"
        if time_us not in self.recording.keyframes_us:
            raise DataError(f"{what} is not at the time of a keyframe.")
        size = to_array(size_m, (3,), f"{what}: size_m")
        if (size <= 0.0).any():
            raise DataError(f"{what} has sides of {size.tolist()} m.")
        pose = to_array(global_from_box, (4, 4), f"{what}: global_from_box")[None]
        check_transforms(pose, what, is_mounting=False)
        number = self.recording.keyframes_us.index(time_us)
        boxes = self.recording.boxes.setdefault(instance, {})
        if number in boxes or any(box.category != category for box in boxes.values()):
            raise DataError(f"{what} is there twice, or of another category than before.")
        boxes[number] = Box(category, size, pose[0])

    def _moment(self, time_s: float, kind: str) -> int:
        """The time in microseconds, between the first and the last pose."""
        time_us = int(to_us([time_s], f"The time of a {kind} of scene '{self.name}'")[0])
        first, last = int(self.recording.time_us[0]), int(self.recording.time_us[-1])
        if not first <= time_us <= last:
            raise DataError(
                f"The {kind} at {time_us / 1e6:.6f} s of scene '{self.name}' lies outside of its "
                f"poses' times, {first / 1e6:.6f} to {last / 1e6:.6f} s."
            )
        return time_us

    def _pose(self, ego_from_sensor: Numbers, what: str) -> FloatArray:
        pose = to_array(ego_from_sensor, (4, 4), f"{what}: its mounting")
        check_transforms(pose[None], f"{what}: its mounting", is_mounting=True)
        return pose

    def _mount(self, channel: str, mounting: Mounting, what: str) -> None:
        if check_name(channel, "sensor") in self.recording.mountings:
            raise DataError(f"{what} is there already.")
        self.recording.mountings[channel] = mounting

    def _image(self, channel: str, file: Path, time_s: float, keyframe: int) -> Frame:
        time_us = self._moment(time_s, f"image of '{channel}'")
        if (channel, time_us) in self.recording.frames:
            raise DataError(f"Scene '{self.name}' has two images of '{channel}' at {time_s:.6f} s.")
        problem = image_problem(file, self.recording.mountings[channel].image_hw)
        if problem is not None:
            raise DataError(problem.what)
        name = f"samples/{channel}/{self.name}__{channel}__{time_us}{file.suffix.lower()}"
        return Frame(channel, time_us, place_file(file, self._root, name), keyframe)

    def _sweep(self, time_us: int, sweep: str | Path | Numbers, keyframe: int | None) -> Frame:
        if (LIDAR, time_us) in self.recording.frames:
            raise DataError(f"Scene '{self.name}' has two sweeps at {time_us / 1e6:.6f} s.")
        folder = "sweeps" if keyframe is None else "samples"
        name = f"{folder}/{LIDAR}/{self.name}__{LIDAR}__{time_us}.pcd.bin"
        if isinstance(sweep, str | Path):
            # The scene's other sweeps, by whose size a cut one is known, may be still to come.
            problem = sweep_problem(Path(sweep), SceneSweeps(self._root, ()))
            if problem is not None:
                raise DataError(problem.what)
            name = place_file(Path(sweep), self._root, name)
        else:
            name = place_bytes(self._points(sweep).tobytes(), self._root, name)
        return Frame(LIDAR, time_us, name, keyframe)

    def _points(self, sweep: Numbers) -> NDArray[np.float32]:
        """[P, 5]; a ring that is not known is 0."""
        points = np.asarray(sweep, dtype=np.float32)
        if points.ndim != 2 or points.shape[1] not in (4, 5) or not len(points):
            raise DataError(
                f"A sweep of scene '{self.name}' must be points [P, 4] or [P, 5], got "
                f"{list(points.shape)}."
            )
        return np.pad(points, ((0, 0), (0, 5 - points.shape[1])))


def check_name(name: str, kind: str) -> str:
    """The name, if files can be called after it.

    Raises:
        DataError: If not.
    """
    if not is_plain(name) or len(name.encode()) > _LONGEST_NAME:
        raise DataError(
            f"The {kind} name '{name}' cannot be: at most {_LONGEST_NAME} bytes, no slash and no "
            "control character."
        )
    return name
