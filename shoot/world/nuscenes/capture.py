"""Drives through one recorded scene and writes its images, sweeps and table rows."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from lss_core.data.writing.table_rows import Row, chain, token
from lss_core.files import write_atomically
from shoot.world.looks.paint import Paint
from shoot.world.looks.scenery import ego_pose
from shoot.world.nuscenes.tables import AnnotationBook, calibration_rows, pose_row
from shoot.world.nuscenes.tiling import LOCATIONS, Tile, seed_of
from shoot.world.sensing.rig import make_rig
from shoot.world.sensing.rig_plans import DELAY_ERROR_US, LIDAR_PERIOD_S, RIG_PLANS, RigName
from shoot.world.sensing.sensors import CitySensors, Sweep
from shoot.world.town.town import FloatArray, Town
from shoot.world.traffic.scenario import describe, make_look, make_scenario

LIDAR = "LIDAR_TOP"
JPEG_QUALITY = 90
AGENT_REACH_M, PARKED_REACH_M = 80.0, 60.0
_FIRST_STAMP_US = 1_767_225_600_000_000  # 1 January 2026


@dataclass(frozen=True)
class SceneOrder:
    """What to write.

    Attributes:
        name: Scene name, from nuScenes' split lists.
        split, index: Which scene of which split it is.
        town_index: Which town of the split.
        seed: Of the whole data set.
        duration_s: Length of the scene.
        keyframe_s: Time between keyframes, on average.
        tail_s: Time at the end whose keyframes have no images.
        rig: Which car drives.
        image_scale: Share of the size of the rig's images.
        lidar_azimuths: Lidar firings a turn.
        sweeps: Which sweeps get files.
        tile: Where the town lies.
    """

    name: str
    split: Literal["train", "val"]
    index: int
    town_index: int
    seed: int
    duration_s: float
    keyframe_s: float
    tail_s: float
    rig: RigName
    image_scale: float
    lidar_azimuths: int
    sweeps: Literal["keyframes", "all"]
    tile: Tile


def keyframe_steps(
    num_steps: int, rng: np.random.Generator, keyframe_s: float = 0.5, first: int = 1
) -> list[int]:
    """Lidar turns (`first` to `num_steps`) that are keyframes.

    They are `keyframe_s` apart on average and, as in nuScenes, up to 0.1 s more or less.
    """
    apart = round(keyframe_s / LIDAR_PERIOD_S)
    steps = [first]
    while True:
        late = int(rng.choice([-2, -1, 0, 1, 2], p=[0.05, 0.2, 0.5, 0.2, 0.05]))
        steps.append(steps[-1] + apart + late)
        if steps[-1] > num_steps:
            return steps[:-1]


def texel_m(image_scale: float) -> float:
    """Finest texture worth painting for images of a scale."""
    return 0.1 if image_scale >= 0.2 else 0.16


def capture_scene(order: SceneOrder, town: Town, paint: Paint, root: Path) -> dict[str, list[Row]]:
    """Write the files of one scene and return its rows by table.

    Args:
        order: What to write.
        town: Its town.
        paint: The town's ground, at `texel_m` of the images' scale.
        root: Folder of the data set.

    Raises:
        OSError: If a file cannot be written.
    """
    scene_seed = seed_of(order.seed, order.split, "scene", order.index)
    recording = make_scenario(town, scene_seed, order.duration_s)
    look = make_look(scene_seed)
    plan = RIG_PLANS[order.rig]
    rig = make_rig(scene_seed, order.image_scale, order.lidar_azimuths, plan)
    image_hw = {camera.channel: (camera.height_px, camera.width_px) for camera in rig.cameras}
    sensors = CitySensors(town, recording, look, rig, scene_seed, paint)
    rng = np.random.default_rng([scene_seed, 21])
    name, seed = order.name, order.seed
    origin_m = order.tile.origin_m
    first_us = _FIRST_STAMP_US + (scene_seed % 100_000) * 3_600_000_000 // 100 * 100
    logfile = f"synthetic-{order.split}-{order.town_index:04d}-{name}"
    calibration = calibration_rows(rig, name, seed)
    poses: list[Row] = []
    data: list[Row] = []
    samples: list[Row] = []
    book = AnnotationBook(seed, name)

    def record(channel: str, time_us: int, sample_token: str, is_key_frame: bool) -> Row:
        x, y, yaw = ego_pose(recording, time_us / 1e6)
        stamp_us = first_us + time_us
        row_token = token(seed, name, "sample_data", channel, stamp_us)
        height_px, width_px = image_hw.get(channel, (0, 0))
        poses.append(pose_row(row_token, stamp_us, np.array([x, y]) + origin_m, yaw))
        is_lidar = channel == LIDAR
        folder = "samples" if is_key_frame else "sweeps"
        ending = "pcd.bin" if is_lidar else "jpg"
        row = {
            "token": row_token,
            "sample_token": sample_token,
            "ego_pose_token": row_token,
            "calibrated_sensor_token": calibration[channel]["token"],
            "timestamp": stamp_us,
            "fileformat": "pcd" if is_lidar else "jpg",
            "is_key_frame": is_key_frame,
            "height": height_px,
            "width": width_px,
            "filename": f"{folder}/{channel}/{logfile}__{channel}__{stamp_us}.{ending}",
            "prev": "",
            "next": "",
        }
        data.append(row)
        return row

    num_steps = round(order.duration_s / LIDAR_PERIOD_S)
    tail_steps = round(order.tail_s / LIDAR_PERIOD_S)
    pictured = keyframe_steps(num_steps - tail_steps, rng, order.keyframe_s, first=plan.first_turn)
    # Random numbers of their own: when images are taken does not hang on the tail's keyframes.
    tail_rng = np.random.default_rng([scene_seed, 22])
    after = keyframe_steps(num_steps, tail_rng, order.keyframe_s, pictured[-1])
    # One that has the whole horizon ahead of it would be a sample like the others, without images.
    tail = [step for step in after if step > num_steps - tail_steps]
    keyframes = [*pictured, *(tail if tail_steps else [])]
    for step in keyframes:
        time_us = round(step * LIDAR_PERIOD_S * 1e6)
        samples.append({
            "token": token(seed, name, "sample", step),
            "timestamp": first_us + time_us,
            "prev": "",
            "next": "",
            "scene_token": token(seed, name, "scene"),
        })  # fmt: skip
    chain(samples)

    turns: list[Row] = []
    for step in range(1, num_steps + 1):
        # A turn belongs to the keyframe it leads to; the last ones to the last.
        nearest = min(int(np.searchsorted(keyframes, step)), len(keyframes) - 1)
        is_key_frame = keyframes[nearest] == step
        time_us = round(step * LIDAR_PERIOD_S * 1e6)
        row = record(LIDAR, time_us, samples[nearest]["token"], is_key_frame)
        turns.append(row)
        # Nothing reads the sweeps between the keyframes of the tail.
        if is_key_frame or (order.sweeps == "all" and step <= num_steps - tail_steps):
            sweep = sensors.sweep(time_us / 1e6)
            _write_bytes(root / row["filename"], sweep.points.tobytes())
            if is_key_frame:
                _annotate(book, samples[nearest]["token"], sensors, sweep, time_us / 1e6, origin_m)
    chain(turns)

    for camera in rig.cameras:
        shots: list[Row] = []
        for step, sample in zip(pictured, samples[: len(pictured)], strict=True):
            delay_us = round(camera.delay_s * 1e6 + rng.uniform(-DELAY_ERROR_US, DELAY_ERROR_US))
            time_us = round(step * LIDAR_PERIOD_S * 1e6) + delay_us
            row = record(camera.channel, time_us, sample["token"], True)
            shots.append(row)
            picture = sensors.image(camera, time_us / 1e6)
            quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
            _, encoded = cv2.imencode(".jpg", picture[..., ::-1], quality)
            _write_bytes(root / row["filename"], encoded.tobytes())
        chain(shots)

    instances, annotations = book.rows()
    scene = {
        "token": token(seed, name, "scene"),
        "log_token": token(seed, name, "log"),
        "nbr_samples": len(samples),
        "first_sample_token": samples[0]["token"],
        "last_sample_token": samples[-1]["token"],
        "name": name,
        "description": describe(town, recording, look),
    }
    log = {
        "token": scene["log_token"],
        "logfile": logfile,
        "vehicle": "synthetic",
        "date_captured": str(np.datetime64(first_us, "us").astype("datetime64[D]")),
        "location": LOCATIONS[order.tile.location].name,
    }
    return {
        "instance": instances,
        "calibrated_sensor": list(calibration.values()),
        "ego_pose": poses,
        "log": [log],
        "scene": [scene],
        "sample": samples,
        "sample_data": data,
        "sample_annotation": annotations,
    }


def _write_bytes(path: Path, content: bytes) -> None:
    with write_atomically(path, one_of_many=True) as stream:
        stream.write(content)


def _annotate(
    book: AnnotationBook,
    sample_token: str,
    sensors: CitySensors,
    sweep: Sweep,
    time_s: float,
    origin_m: FloatArray,
) -> None:
    """Note the boxes of all road users and parked cars that the lidar touched or the ego sees."""
    town, recording = sensors.town, sensors.recording
    x, y, _ = ego_pose(recording, time_s)
    ego_m = np.array([x, y])
    parked = [
        (index, car)
        for index, car in enumerate(town.parked_cars)
        if np.hypot(*(car.xy_m - ego_m)) < PARKED_REACH_M
    ]
    boxes = [
        (index, "car", car.xy_m, car.yaw_rad, car.size_m, "vehicle.parked") for index, car in parked
    ]
    moment = sensors.movers.at(time_s).within(ego_m, AGENT_REACH_M)
    for k, index in enumerate(moment.index.tolist()):
        agent, moves = recording.agents[index], bool(moment.speed_mps[k] > 0.2)
        if agent.kind == "pedestrian":
            state = "pedestrian.moving" if moves else "pedestrian.standing"
        else:
            state = "vehicle.moving" if moves else "vehicle.stopped"
        number, yaw_rad = len(town.parked_cars) + index, float(moment.yaw_rad[k])
        boxes.append((number, agent.kind, moment.xy_m[k], yaw_rad, agent.size_m, state))
    if not boxes:
        return
    ids = np.array([box[0] for box in boxes], np.int32)
    points = np.stack([_inside_points(xy, yaw, size) for _, _, xy, yaw, size, _ in boxes])
    shares = sensors.visible_share(points, time_s, ids)
    touched = np.bincount(
        sweep.object_ids[sweep.object_ids >= 0],
        minlength=len(town.parked_cars) + len(recording.agents),
    )
    for (number, kind, xy, yaw, size, state), share in zip(boxes, shares, strict=True):
        count = int(touched[number])
        if count > 0 or share >= 0.4:
            centre = np.array([*(xy + origin_m), size[2] / 2])
            book.add(sample_token, number, kind, centre, yaw, size, state, float(share), count)


def _inside_points(xy_m: FloatArray, yaw_rad: float, size_m: FloatArray) -> FloatArray:
    """Points [12, 3] spread through a box, within what is surely body and not air."""
    shares = np.array([
        [x, y, z] for x in (-0.38, 0.0, 0.38) for y in (-0.3, 0.3) for z in (0.35, 0.55)
    ])  # fmt: skip
    local = shares * size_m
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    flat = local[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + xy_m
    return np.column_stack([flat, local[:, 2]])
