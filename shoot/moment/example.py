"""A rig file and the images of one moment, to try the command on: drawn, not photographed."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lss_core.config import CAMERAS
from lss_core.files import write_atomically
from shoot.moment.rig_file import RigCamera
from shoot.simulation.senses import Senses, SensorSettings
from shoot.world.looks.scenery import ego_pose
from shoot.world.nuscenes.tiling import seed_of
from shoot.world.town.roads import make_town
from shoot.world.traffic.scenario import make_scenario

RIG_FILE = "rig.yaml"
# A town of those that planners of this city are evaluated in, which no training has seen.
_SEED, _SPLIT, _SCENE = 0, "val", 5
_TIME_S, _IMAGE_SCALE = 4.4, 0.25
_DURATION_S = 20.0  # as of the scenes of a data set

_HEADER = """\
# A rig: its cameras, each with the size of its images, intrinsics and mounting.
#
# The ego frame: x forward, y to the left, z up, in metres; its origin lies on the ground below the
# middle of the rear axle. A camera's frame: x to the right, y down, z forward.
#
# intrinsics: fx, fy, cx and cy in pixels, or a 3 x 3 matrix (rows). Pixel (0, 0) has its centre at
# (0, 0). Cameras are pinholes: undistort images first.
#
# The mounting: position_m (x, y, z in the ego frame) and angles of the viewing direction in
# degrees. yaw_deg: 0 ahead, positive to the left. pitch_deg: 0 level, positive up. roll_deg: about
# the viewing direction, 0 upright, positive if the camera's right side goes down. Or, in place of
# these four, ego_from_camera: a 4 x 4 matrix (rows) of points in the camera's frame into the ego's.
#
# delay_s: when the camera fires, in seconds after the moment that is planned from (negative:
# before). Not needed where all fire at once.
"""


def write_example(folder: Path) -> tuple[dict[str, Path], float]:
    """Write `rig.yaml` and an image of each of its cameras.

    Args:
        folder: For all of it; made if needed.

    Returns:
        Name of a camera -> its image; and how fast the car drives, in m/s.

    Raises:
        OSError: If a file cannot be written.
    """
    town = make_town(seed_of(_SEED, _SPLIT, "town", _SCENE))
    seed = seed_of(_SEED, _SPLIT, "scene", _SCENE)
    recording = make_scenario(town, seed, _DURATION_S)
    car = SensorSettings(image_scale=_IMAGE_SCALE, cameras=CAMERAS)
    senses = Senses(town, seed, car, recording)
    paths, cameras = {}, []
    for mounted, view in zip(senses.cameras, senses.look(recording, _TIME_S).views, strict=True):
        path = folder / f"{view.channel}.jpg"
        with write_atomically(path) as stream:
            stream.write(view.jpeg)
        paths[view.channel] = path
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
        stream.write((_HEADER + format_rig(cameras)).encode())
    # A turn is of no account within the hundredths of a second that lie between cameras.
    now, before = (np.asarray(ego_pose(recording, _TIME_S - age_s)[:2]) for age_s in (0.0, 0.1))
    return paths, float(np.linalg.norm(now - before)) / 0.1


def format_rig(cameras: list[RigCamera]) -> str:
    """The text of a rig file, with angles rather than matrices; lengths to 0.1 mm."""
    return "cameras:\n" + "".join(map(_entry, cameras))


def _entry(camera: RigCamera) -> str:
    k = camera.rawpixel_from_camera
    height_px, width_px = camera.image_hw
    x_m, y_m, z_m = camera.ego_from_camera[:3, 3]
    # Forward, left and up of a camera, in place of its right, down and forward.
    body = camera.ego_from_camera[:3, :3] @ np.asarray([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    delay = f"    delay_s: {camera.delay_s:.4f}\n" if camera.delay_s else ""
    yaw, down, roll = np.rad2deg(Rotation.from_matrix(body).as_euler("ZYX"))
    return (
        f"  - name: {camera.name}\n"
        f"    width_px: {width_px}\n"
        f"    height_px: {height_px}\n"
        f"    intrinsics: {{fx: {k[0, 0]:.4f}, fy: {k[1, 1]:.4f}, cx: {k[0, 2]:.4f}, "
        f"cy: {k[1, 2]:.4f}}}\n"
        f"    position_m: [{x_m:.4f}, {y_m:.4f}, {z_m:.4f}]\n"
        f"    yaw_deg: {yaw:.4f}\n"
        f"    pitch_deg: {-down:.4f}\n"
        f"    roll_deg: {roll:.4f}\n"
        f"{delay}"
    )
