"""A rig file as text: cameras with angles rather than matrices, and what its keys mean."""

import numpy as np
from scipy.spatial.transform import Rotation

from shoot.moment.rig_file import RigCamera

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


def format_rig(cameras: list[RigCamera]) -> str:
    """The text of a rig file, with angles rather than matrices; lengths to 0.1 mm."""
    return _HEADER + "cameras:\n" + "".join(map(_entry, cameras))


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
