import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_tables import (
    KEPT_A_SCENE,
    KEYFRAMES_A_SCENE,
    SWEEPS_A_SCENE,
    SWEEPS_KEPT_A_SCENE,
    TRAIN_A,
    TRAIN_B,
    VERSION,
    TinyScene,
)

from lss_core.data.samples import SampleIndex, load_index, rows_of_split
from shoot.trajectories import futures_from_poses, mine_futures, past_from_poses

Poses = tuple[np.ndarray, np.ndarray, np.ndarray]


def drive(scene: TinyScene, times_s: np.ndarray) -> Poses:
    """Exact poses of an arc at the given times."""
    poses = np.array([scene.pose(float(time)) for time in times_s])
    return times_s, poses[:, :2], poses[:, 2]


def random_drive(seed: int, num: int = 120) -> Poses:
    """An uneven, winding drive of about 12 s."""
    rng = np.random.default_rng(seed)
    times_s = np.cumsum(rng.uniform(0.03, 0.18, num))
    yaw = np.cumsum(rng.normal(0.0, 0.05, num)) + rng.uniform(-4.0, 4.0)
    steps = rng.uniform(0.0, 1.5, num)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    return times_s, np.cumsum(steps, axis=0) + rng.uniform(-500.0, 500.0, 2), yaw


def test_straight_drive_at_an_angle_goes_forward_only() -> None:
    # Heading 120 degrees at 8 m/s: 2 m forward every quarter of a second.
    times_s = np.arange(0.0, 6.01, 0.1)
    heading = math.radians(120.0)
    xy_m = np.array([30.0, -20.0]) + 8.0 * times_s[:, None] * [math.cos(heading), math.sin(heading)]
    futures, kept = futures_from_poses(
        times_s, xy_m, np.full(len(times_s), heading), np.array([0.73])
    )
    assert kept.tolist() == [True]
    assert futures.shape == (1, 20, 2)
    np.testing.assert_allclose(futures[0, :, 0], 2.0 * np.arange(1, 21), atol=1e-9)
    np.testing.assert_allclose(futures[0, :, 1], 0.0, atol=1e-9)


def test_left_circle_by_hand() -> None:
    # Radius 10 m, a quarter turn to the left in 5 s: ends 10 m ahead and 10 m to the left.
    scene = TinyScene(
        "arc", speed_mps=math.pi, yaw_rate_radps=math.pi / 10.0, yaw_rad=2.3, x_m=-7.0, y_m=41.0
    )
    futures, _ = futures_from_poses(*drive(scene, np.arange(0.0, 8.0, 0.05)), np.array([1.5]))
    angle = math.pi / 10.0 * 0.25 * np.arange(1, 21)
    np.testing.assert_allclose(futures[0, :, 0], 10.0 * np.sin(angle), atol=2e-3)
    np.testing.assert_allclose(futures[0, :, 1], 10.0 * (1.0 - np.cos(angle)), atol=2e-3)
    np.testing.assert_allclose(futures[0, -1], [10.0, 10.0], atol=2e-3)
    assert (futures[0] > 0.0).all()


def test_right_turn_goes_to_negative_y() -> None:
    scene = TinyScene("arc", speed_mps=4.0, yaw_rate_radps=-0.2)
    futures, _ = futures_from_poses(*drive(scene, np.arange(0.0, 6.0, 0.1)), np.array([0.0]))
    assert (np.diff(futures[0, :, 1], prepend=0.0) < 0.0).all()


def test_start_itself_is_no_point() -> None:
    # A car that stands for 2 s and then drives: the first 8 points are the start's place.
    times_s = np.array([0.0, 2.0, 5.0])
    xy_m = np.array([[5.0, 5.0], [5.0, 5.0], [8.0, 5.0]])
    futures, _ = futures_from_poses(times_s, xy_m, np.zeros(3), np.array([0.0]))
    assert futures.shape[1] == 20
    np.testing.assert_allclose(futures[0, :8], 0.0)
    np.testing.assert_allclose(futures[0, 8:, 0], 0.25 * np.arange(1, 13))


def test_positions_are_linear_between_uneven_poses() -> None:
    # Poses at 0, 1, 4 and 6 s; x is 0, 4, 10, 10.
    times_s = np.array([0.0, 1.0, 4.0, 6.0])
    xy_m = np.array([[0.0, 0.0], [4.0, 0.0], [10.0, 0.0], [10.0, 0.0]])
    futures, _ = futures_from_poses(times_s, xy_m, np.zeros(4), np.array([0.5]))
    # Start at x = 2; 0.75 s later t = 1.25, x = 4.5; 3.5 s later t = 4, x = 10; then standing.
    np.testing.assert_allclose(futures[0, [0, 1, 2, 13, 19], 0], [1.0, 2.0, 2.5, 8.0, 8.0])


def test_start_needs_a_whole_future_and_a_past() -> None:
    poses = drive(TRAIN_A, np.arange(0.0, 8.01, 0.5))
    starts_s = np.array([-0.1, 0.0, 1.7, 3.0, 3.0 + 5e-7, 3.01, 7.9, 8.0])
    futures, kept = futures_from_poses(*poses, starts_s)
    assert kept.tolist() == [False, True, True, True, True, False, False, False]
    assert len(futures) == 4
    assert np.isfinite(futures).all()


def test_jump_of_a_whole_turn_changes_nothing() -> None:
    scene = TinyScene("arc", speed_mps=5.0, yaw_rate_radps=0.3, yaw_rad=2.8)
    times_s, xy_m, yaw = drive(scene, np.arange(0.0, 9.0, 0.2))
    wrapped = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(np.diff(wrapped)).max() > 6.0
    starts_s = np.arange(0.0, 3.5, 0.07)
    expected, _ = futures_from_poses(times_s, xy_m, yaw, starts_s)
    got, _ = futures_from_poses(times_s, xy_m, wrapped, starts_s)
    np.testing.assert_allclose(got, expected, atol=1e-9)


@pytest.mark.parametrize("times_s", [[0.0, 1.0, 1.0, 6.0], [0.0, 2.0, 1.0, 6.0]])
def test_times_that_do_not_increase_are_refused(times_s: list[float]) -> None:
    with pytest.raises(ValueError, match="increase"):
        futures_from_poses(np.array(times_s), np.zeros((4, 2)), np.zeros(4), np.array([0.0]))


def test_horizon_must_be_whole_steps() -> None:
    with pytest.raises(ValueError, match="whole number"):
        futures_from_poses(
            np.array([0.0, 9.0]), np.zeros((2, 2)), np.zeros(2), np.array([0.0]), horizon_s=1.1
        )


def test_no_poses_keep_no_start() -> None:
    futures, kept = futures_from_poses(
        np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.array([0.0, 1.0])
    )
    assert futures.shape == (0, 20, 2)
    assert kept.tolist() == [False, False]


@given(
    seed=st.integers(0, 1000),
    turn=st.floats(-7.0, 7.0),
    east_m=st.floats(-2000.0, 2000.0),
    north_m=st.floats(-2000.0, 2000.0),
)
def test_where_the_map_lies_does_not_matter(
    seed: int, turn: float, east_m: float, north_m: float
) -> None:
    times_s, xy_m, yaw = random_drive(seed)
    starts_s = np.linspace(times_s[0], times_s[-1], 17)
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    moved_m = xy_m @ rotation.T + [east_m, north_m]
    expected, kept = futures_from_poses(times_s, xy_m, yaw, starts_s)
    got, kept_too = futures_from_poses(times_s, moved_m, yaw + turn, starts_s)
    assert kept.tolist() == kept_too.tolist()
    np.testing.assert_allclose(got, expected, atol=1e-8)


@given(seed=st.integers(0, 1000))
def test_matches_a_plain_loop(seed: int) -> None:
    times_s, xy_m, yaw = random_drive(seed)
    starts_s = np.random.default_rng(seed).uniform(times_s[0] - 1.0, times_s[-1], 9)
    futures, kept = futures_from_poses(times_s, xy_m, yaw, starts_s)

    def at(time_s: float) -> tuple[complex, float]:
        i = min(int(np.searchsorted(times_s, time_s, side="right")) - 1, len(times_s) - 2)
        share = (time_s - times_s[i]) / (times_s[i + 1] - times_s[i])
        place = xy_m[i] * (1.0 - share) + xy_m[i + 1] * share
        return complex(*place), yaw[i] * (1.0 - share) + yaw[i + 1] * share

    row = 0
    for start_s, is_kept in zip(starts_s, kept, strict=True):
        assert is_kept == (times_s[0] <= start_s <= times_s[-1] - 5.0)
        if not is_kept:
            continue
        origin, heading = at(start_s)
        for point in range(20):
            away = (at(start_s + 0.25 * (point + 1))[0] - origin) * np.exp(-1j * heading)
            np.testing.assert_allclose(futures[row, point], [away.real, away.imag], atol=1e-8)
        row += 1
    assert row == len(futures)


def test_past_of_a_left_circle_by_hand() -> None:
    # Radius 10 m, pi / 20 rad in half a second: behind and to the left, where the circle came from.
    scene = TinyScene(
        "arc", speed_mps=math.pi, yaw_rate_radps=math.pi / 10.0, yaw_rad=2.3, x_m=-7.0, y_m=41.0
    )
    past, known = past_from_poses(*drive(scene, np.arange(0.0, 8.0, 0.05)), np.array([3.0]))
    assert known.all()
    angle = math.pi / 10.0 * 0.25 * np.arange(1, 9)
    np.testing.assert_allclose(past[0, :, 0], -10.0 * np.sin(angle), atol=2e-3)
    np.testing.assert_allclose(past[0, :, 1], 10.0 * (1.0 - np.cos(angle)), atol=2e-3)


def test_past_ends_where_the_recording_begins() -> None:
    # 2 m/s from 0.1 s on; 0.85 s reaches back three steps, 0.6 s exactly two.
    times_s = np.array([0.1, 0.35, 0.6, 0.85, 4.0])
    xy_m = np.stack([2.0 * times_s, np.full(5, 7.0)], axis=-1)
    past, known = past_from_poses(times_s, xy_m, np.zeros(5), np.array([0.1, 0.6, 0.85, 4.0]))
    assert known.sum(1).tolist() == [0, 2, 3, 8]
    np.testing.assert_allclose(past[2, :3], [[-0.5, 0.0], [-1.0, 0.0], [-1.5, 0.0]])
    assert not past[~known].any()


@given(seed=st.integers(0, 1000))
def test_past_is_the_future_of_a_car_that_drives_backwards(seed: int) -> None:
    times_s, xy_m, yaw = random_drive(seed)
    starts_s = np.linspace(times_s[0] + 2.01, times_s[-1], 11)
    past, known = past_from_poses(times_s, xy_m, yaw, starts_s)
    assert known.all()
    expected, _ = futures_from_poses(
        -times_s[::-1], xy_m[::-1], yaw[::-1], -starts_s[::-1], horizon_s=2.0
    )
    np.testing.assert_allclose(past, expected[::-1], atol=1e-8)


@given(seed=st.integers(0, 1000))
def test_past_never_sees_the_future(seed: int) -> None:
    # Two drives that part after a pose; from there they share nothing.
    times_s, xy_m, yaw = random_drive(seed)
    other_times_s, other_xy_m, other_yaw = random_drive(seed + 1)
    now = 70
    later_s = times_s[now] + other_times_s
    starts_s = times_s[: now + 1]
    expected = past_from_poses(times_s, xy_m, yaw, starts_s)
    got = past_from_poses(
        np.concatenate([starts_s, later_s]),
        np.concatenate([xy_m[: now + 1], other_xy_m]),
        np.concatenate([yaw[: now + 1], other_yaw]),
        starts_s,
    )
    np.testing.assert_array_equal(got[0], expected[0])
    np.testing.assert_array_equal(got[1], expected[1])


@pytest.fixture(scope="module")
def index(tiny_root: Path) -> SampleIndex:
    return load_index(tiny_root, VERSION, ("CAM_FRONT",))


def test_mining_keyframes_counts_what_it_leaves_out(index: SampleIndex, tiny_root: Path) -> None:
    rows = rows_of_split(index, tiny_root, VERSION, "train")
    futures = mine_futures(index, rows, "keyframes")
    assert len(futures.xy_m) == 2 * KEPT_A_SCENE
    assert futures.num_left_out == 2 * (KEYFRAMES_A_SCENE - KEPT_A_SCENE)
    # Each scene's first keyframes, in order; no start looks into another scene.
    tokens = index.sample_token[futures.sample].tolist()
    assert tokens == [f"scene-000{s}-{i:02d}" for s in (1, 2) for i in range(KEPT_A_SCENE)]
    assert index.sample_scene[futures.sample].tolist() == futures.scene.tolist()


def test_mining_at_another_horizon_and_step(index: SampleIndex, tiny_root: Path) -> None:
    """4 s at 10 Hz: at whole seconds where 5 s every 0.25 s are; two starts a scene more."""
    rows = rows_of_split(index, tiny_root, VERSION, "train")
    fine = mine_futures(index, rows, "keyframes", horizon_s=4.0, dt_s=0.1)
    usual = mine_futures(index, rows, "keyframes")
    assert (fine.dt_s, usual.dt_s) == (0.1, 0.25)
    assert len(fine.xy_m) == 2 * (KEPT_A_SCENE + 2)
    both = np.isin(fine.sample, usual.sample)
    np.testing.assert_allclose(
        fine.select(both).xy_m[:, 9::10], usual.xy_m[:, 3:16:4], rtol=0.0, atol=1e-9
    )
    # The past has times of its own.
    for name in ("velocity_mps", "yaw_rate_radps", "past_xy_m", "past_known"):
        np.testing.assert_array_equal(getattr(fine.select(both), name), getattr(usual, name))


def test_mining_sweeps_uses_every_lidar_pose(index: SampleIndex, tiny_root: Path) -> None:
    rows = rows_of_split(index, tiny_root, VERSION, "train")
    futures = mine_futures(index, rows, "sweeps")
    assert len(futures.xy_m) == 2 * SWEEPS_KEPT_A_SCENE
    assert futures.num_left_out == 2 * (SWEEPS_A_SCENE - SWEEPS_KEPT_A_SCENE)
    assert (futures.sample == -1).all()


def test_mined_futures_and_motion_are_the_arcs(index: SampleIndex, tiny_root: Path) -> None:
    rows = rows_of_split(index, tiny_root, VERSION, "train")
    futures = mine_futures(index, rows, "keyframes")
    times_s = 0.25 * np.arange(1, 21)
    for number, scene in enumerate((TRAIN_A, TRAIN_B)):
        radius_m = scene.speed_mps / scene.yaw_rate_radps
        angle = scene.yaw_rate_radps * times_s
        arc = radius_m * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=-1)
        own = futures.scene == number
        np.testing.assert_allclose(futures.xy_m[own], np.tile(arc, (own.sum(), 1, 1)), atol=2e-3)
        # Before the first keyframe nothing is known; later the last half second tells the arc.
        np.testing.assert_array_equal(futures.velocity_mps[own][0], [0.0, 0.0])
        np.testing.assert_allclose(
            futures.velocity_mps[own][1:, 0], scene.speed_mps, atol=0.02 * scene.speed_mps
        )
        np.testing.assert_allclose(futures.yaw_rate_radps[own][1:], scene.yaw_rate_radps, atol=1e-6)
        # Keyframes every half second: two steps of a quarter more each, until all eight are known.
        known = futures.past_known[own]
        assert known.sum(1).tolist() == [0, 2, 4, 6, 8, 8, 8]
        back = -scene.yaw_rate_radps * times_s[:8]
        arc = radius_m * np.stack([np.sin(back), 1.0 - np.cos(back)], axis=-1)
        expected = np.where(known[..., None], arc, 0.0)
        np.testing.assert_allclose(futures.past_xy_m[own], expected, atol=2e-3)


def test_recent_motion_never_sees_the_future(tmp_path: Path) -> None:
    # Two recordings that agree up to 2 s and differ afterwards.
    index_of = {}
    for name, later_mps in (("slow", 1.0), ("fast", 12.0)):
        times_s = np.arange(0.0, 9.01, 0.1)
        x_m = np.where(times_s <= 2.0, 5.0 * times_s, 10.0 + later_mps * (times_s - 2.0))
        index_of[name] = _index_of_track(times_s, x_m)
    rows = np.arange(5)
    slow = mine_futures(index_of["slow"], rows, "keyframes")
    fast = mine_futures(index_of["fast"], rows, "keyframes")
    assert not np.allclose(slow.xy_m, fast.xy_m)
    np.testing.assert_array_equal(slow.velocity_mps, fast.velocity_mps)
    np.testing.assert_array_equal(slow.yaw_rate_radps, fast.yaw_rate_radps)
    np.testing.assert_array_equal(slow.past_xy_m, fast.past_xy_m)
    np.testing.assert_array_equal(slow.past_known, fast.past_known)


def _index_of_track(times_s: np.ndarray, x_m: np.ndarray) -> SampleIndex:
    num = 5
    eye = np.tile(np.eye(4), (num, 1, 1))
    names = np.asarray(["scene"])
    return SampleIndex(
        cameras=np.asarray(["CAM_FRONT"]),
        sample_token=np.asarray([str(i) for i in range(num)]),
        sample_scene=np.zeros(num, dtype=np.int64),
        time_s=0.5 * np.arange(num),
        global_from_ego=eye,
        has_camera=np.zeros((num, 1), dtype=bool),
        image_path=np.full((num, 1), ""),
        image_hw=np.zeros((num, 1, 2), dtype=np.int64),
        rawpixel_from_camera=np.tile(np.eye(3), (num, 1, 1, 1)),
        egocam_from_camera=eye[:, None],
        global_from_egocam=eye[:, None],
        camera_time_s=np.zeros((num, 1)),
        lidar_path=np.full(num, ""),
        ego_from_lidar=eye,
        scene_name=names,
        scene_token=names,
        scene_description=names,
        scene_location=names,
        scene_log=names,
        track_start=np.asarray([0, len(times_s)]),
        track_time_s=times_s,
        track_xy_m=np.stack([x_m, np.zeros_like(x_m)], axis=-1),
        track_yaw_rad=np.zeros_like(x_m),
        global_from_track=np.tile(np.eye(4), (len(times_s), 1, 1)),
        sweep_path=np.full(len(times_s), b""),
        problem_reason=np.asarray([""]),
        problem_text=np.asarray([""]),
        scene_problem=np.zeros(1, dtype=np.int64),
        camera_problem=np.zeros((num, 1), dtype=np.int64),
        lidar_problem=np.zeros(num, dtype=np.int64),
        warning_reason=np.asarray([], dtype=np.str_),
        warning_text=np.asarray([], dtype=np.str_),
    )


def test_selection_keeps_the_count(index: SampleIndex, tiny_root: Path) -> None:
    futures = mine_futures(index, rows_of_split(index, tiny_root, VERSION, "val"), "keyframes")
    mask = np.arange(len(futures.sample)) % 3 == 0
    chosen = futures.select(mask)
    np.testing.assert_array_equal(chosen.xy_m, futures.xy_m[mask])
    np.testing.assert_array_equal(chosen.sample, futures.sample[mask])
    np.testing.assert_array_equal(chosen.past_xy_m, futures.past_xy_m[mask])
    np.testing.assert_array_equal(chosen.past_known, futures.past_known[mask])
    assert len(chosen.sample) + chosen.num_left_out == len(futures.sample) + futures.num_left_out
