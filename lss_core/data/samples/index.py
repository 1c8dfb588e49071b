"""What is known of a data set's samples, cameras, poses and scenes, as arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.problems import Problem
from lss_core.errors import DataError
from lss_core.geometry import FloatArray

# Time stamps are whole microseconds but travel as float64 seconds since 1970.
TIME_TOLERANCE_S = 1e-6


# Texts are annotated `np.character`: checked at run time, `np.str_` stands for empty texts only.
@dataclass(frozen=True)
class SampleIndex:
    """What is known of S samples, N cameras, C scenes and P ego poses, without opening the tables.

    The ego frame of a sample is that of its keyframe LIDAR_TOP sweep (of the sample's own time
    stamp in scenes without lidar). Poses of a scene c are rows `track_start[c]:track_start[c + 1]`,
    one per LIDAR_TOP sweep, increasing in time. What has a problem is not to be used; its numbers
    do no harm and mean nothing.

    Attributes:
        cameras: [N] channel names.
        sample_token: [S].
        sample_scene: [S] row of its scene.
        time_s: [S] time of the ego frame.
        global_from_ego: [S, 4, 4].
        has_camera: [S, N] whether the sample has a keyframe image of this camera in the tables.
        image_path: [S, N] relative to the data root; empty where there is none.
        image_hw: [S, N, 2] image size according to the tables.
        rawpixel_from_camera: [S, N, 3, 3] intrinsics of the image on disk.
        egocam_from_camera: [S, N, 4, 4] mounting.
        global_from_egocam: [S, N, 4, 4] the car at the camera's own time.
        camera_time_s: [S, N].
        lidar_path: [S] keyframe sweep, relative to the data root; empty where there is none.
        ego_from_lidar: [S, 4, 4] mounting.
        scene_name: [C].
        scene_token: [C].
        scene_description: [C].
        scene_location: [C].
        scene_log: [C] token of the drive it was cut from.
        track_start: [C + 1].
        track_time_s: [P].
        track_xy_m: [P, 2] ego origin in `global`.
        track_yaw_rad: [P] heading in `global`.
        global_from_track: [P, 4, 4] the car at each pose.
        sweep_path: [P] the pose's LIDAR_TOP sweep, relative to the data root, in UTF-8; empty in
            scenes without lidar.
        problem_reason: [Q] kinds of problems; the first is none.
        problem_text: [Q] what is wrong, by file and record; the first is empty.
        scene_problem: [C] which of them a scene's poses have.
        camera_problem: [S, N] which of them calibration, pose or size of an image have.
        lidar_problem: [S] which of them the mounting of the lidar has.
        warning_reason: [W] kinds of what may be meant, but looks like a mistake.
        warning_text: [W] what that is, with counts over the whole data set.
    """

    cameras: NDArray[np.character]
    sample_token: NDArray[np.character]
    sample_scene: NDArray[np.int64]
    time_s: FloatArray
    global_from_ego: FloatArray
    has_camera: NDArray[np.bool_]
    image_path: NDArray[np.character]
    image_hw: NDArray[np.int64]
    rawpixel_from_camera: FloatArray
    egocam_from_camera: FloatArray
    global_from_egocam: FloatArray
    camera_time_s: FloatArray
    lidar_path: NDArray[np.character]
    ego_from_lidar: FloatArray
    scene_name: NDArray[np.character]
    scene_token: NDArray[np.character]
    scene_description: NDArray[np.character]
    scene_location: NDArray[np.character]
    scene_log: NDArray[np.character]
    track_start: NDArray[np.int64]
    track_time_s: FloatArray
    track_xy_m: FloatArray
    track_yaw_rad: FloatArray
    global_from_track: FloatArray
    sweep_path: NDArray[np.character]
    problem_reason: NDArray[np.character]
    problem_text: NDArray[np.character]
    scene_problem: NDArray[np.int64]
    camera_problem: NDArray[np.int64]
    lidar_problem: NDArray[np.int64]
    warning_reason: NDArray[np.character]
    warning_text: NDArray[np.character]

    def problem(self, number: int) -> Problem:
        """The problem of this number, which is not 0."""
        return Problem(str(self.problem_reason[number]), str(self.problem_text[number]))

    def track(self, scene: int) -> slice:
        """Rows of a scene's poses."""
        return slice(int(self.track_start[scene]), int(self.track_start[scene + 1]))

    def row_of(self, token: str) -> int:
        """Row of a sample.

        Raises:
            DataError: If no sample has this token.
        """
        rows = np.flatnonzero(self.sample_token == token)
        if not len(rows):
            raise DataError(f"No sample has the token '{token}' in this data set.")
        return int(rows[0])
