"""Which mistake explains flawed poses: the one whose repair leaves scenes without a flaw."""

from collections.abc import Callable, Iterable

import numpy as np

from lss_core.data.checks.heading import median_angles
from lss_core.data.checks.poses import Flaw, find_flaws
from lss_core.data.tables.tracks import Tracks
from lss_core.data.tables.transforms import reordered
from lss_core.geometry import FloatArray, invert, rigid_from_yaw

# The forward, left and up axes of an ego frame that was given in other axes, as its columns.
_Y_FORWARD = np.asarray([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_Y_BACKWARD = _Y_FORWARD.T
_X_BACKWARD = np.diag([-1.0, -1.0, 1.0])
_X_FORWARD_Z_DOWN = np.diag([1.0, -1.0, -1.0])
_Z_FORWARD_Y_DOWN = np.asarray([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
# A mistake that is undone leaves headings this close to the motion.
_CLOSE_RAD = np.deg2rad(10.0)
# The mean cosine between directions that agree; a degree of noise is a radian there.
_AGREED = 0.5


def likely_mistakes(tracks: Tracks, flaws: dict[int, Flaw]) -> dict[int, str]:
    """The likely mistake behind flaws, by scene; scenes without a known one are left out.

    Args:
        tracks: That have the flaws.
        flaws: By scene.
    """
    known = {scene: flaw.mistake for scene, flaw in flaws.items() if flaw.mistake}
    open_ones = sorted(scene for scene, flaw in flaws.items() if flaw.by_frame)
    if not open_ones:
        return known
    flawed = tracks.choose(open_ones)
    if (flawed.global_from_ego[:, :3, :3] == np.eye(3)).all():
        text = "all rotations are the identity, as if headings had never been written"
        return known | dict.fromkeys(open_ones, text)
    explained: dict[str, set[int]] = {}
    for text, repaired in _repaired(flawed):
        off_rad = median_angles(repaired.motion, open_ones[-1] + 1)
        close = {scene for scene in open_ones if off_rad[scene] < _CLOSE_RAD}
        explained[text] = explained.get(text, set()) | (close - set(find_flaws(repaired)))
    turning = {scene for scene in open_ones if flaws[scene].reason.startswith("heading")}
    explained["the heading looks like degrees taken for radians"] = turning & _of_degrees(flawed)
    # Some fit one scene or another by chance. Of those that explain as much the first is likeliest.
    text, scenes = max(explained.items(), key=lambda entry: len(entry[1]))
    return known | (dict.fromkeys(scenes, text) if 2 * len(scenes) > len(open_ones) else {})


def _repaired(tracks: Tracks) -> Iterable[tuple[str, Tracks]]:
    """Tracks as they were if some mistake had not been made, the simplest mistakes first."""
    poses = tracks.global_from_ego

    def with_poses(changed: FloatArray) -> Tracks:
        return Tracks(tracks.time_s, tracks.scene, changed)

    for text, change in _ROTATIONS.items():
        turned = poses.copy()
        turned[:, :3, :3] = change(poses[:, :3, :3])
        yield text, with_poses(turned)
    yield "the pose looks inverted (ego_from_global)", with_poses(invert(poses))
    # Headings without jumps of a whole turn.
    turned_rad = np.append(0.0, np.cumsum(tracks.steps.turned_rad))
    lengths = tracks.ends - tracks.starts + 1
    first = np.repeat(tracks.starts, lengths)
    yaw_rad = tracks.yaw_rad[first] + turned_rad - turned_rad[first]
    for text, changed_rad in (
        ("the heading looks like a compass course, clockwise from north", np.pi / 2 - yaw_rad),
        ("the heading looks like radians taken for degrees", np.rad2deg(yaw_rad)),
        ("the rotation looks like that of half the heading", 2.0 * yaw_rad),
        ("the rotation looks like that of twice the heading", 0.5 * yaw_rad),
        ("the rotation looks like that of twice the heading", 0.5 * yaw_rad + np.pi),
    ):
        yield text, with_poses(rigid_from_yaw(tracks.place_m[:, :2], changed_rad))


_ROTATIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "the rotation looks like x, y, z, w instead of w, x, y, z": reordered,
    "the rotation looks inverted, or one axis mirrored (a left-handed frame)": (
        lambda turn: np.swapaxes(turn, -1, -2)
    ),
    "the ego's y axis looks forward instead of x (x right)": lambda turn: turn @ _Y_FORWARD,
    "the ego's y axis looks backward and x left": lambda turn: turn @ _Y_BACKWARD,
    "the ego frame looks turned by half a turn (x backward)": lambda turn: turn @ _X_BACKWARD,
    "the ego's axes look like a camera's (x right, y down, z forward)": (
        lambda turn: turn @ _Z_FORWARD_Y_DOWN
    ),
    "the ego's axes look like x forward, y right, z down": lambda turn: turn @ _X_FORWARD_Z_DOWN,
}


def _of_degrees(tracks: Tracks) -> set[int]:
    """Scenes whose headings agree with their motion if degrees had been taken for radians."""
    motion = tracks.motion
    yaw_rad = tracks.yaw_rad[motion.middle]
    found = set()
    for scene in np.unique(motion.scene).tolist():
        own = motion.scene == scene
        degrees = np.rad2deg(motion.direction_rad[own])
        agreed = [np.cos(yaw_rad[own] - turned).mean() for turned in (degrees, degrees % 360)]
        if max(agreed) > _AGREED:
            found.add(scene)
    return found
