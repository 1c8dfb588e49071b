"""nuScenes tables as large as v1.0-trainval's, invented: no images, and nothing of the real ones.

    python scripts/benchmarks/big_tables.py OUT [--scenes 850]

850 scenes have 34,149 samples and 2.6 million sensor records with an ego pose each; columns, tokens
and numbers are as long as the real ones. The same call writes the same bytes.
"""

import argparse
import json
import shutil
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lss_core.config import CAMERAS
from lss_core.data.splits import official_scenes
from lss_core.errors import DataError

VERSION = "v1.0-trainval"
NUM_SCENES = 850
_NUM_LOGS = 68
_RADARS = tuple(
    f"RADAR_{side}" for side in ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "BACK_LEFT", "BACK_RIGHT")
)
_RATE_HZ = {"LIDAR_TOP": 20.0} | dict.fromkeys(CAMERAS, 12.0) | dict.fromkeys(_RADARS, 13.27)
_KEYFRAME_S = 0.5
_LOCATIONS = (
    *(f"singapore-{part}" for part in ("onenorth", "hollandvillage", "queenstown")),
    "boston-seaport",
)
_T0_US = 1_526_915_243_000_000
_LOG_US = 86_400_000_000
_SCENE_US = 25_000_000
_TABLES = (
    "attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map", "sample",
    "sample_annotation", "sample_data", "scene", "sensor", "visibility",
)  # fmt: skip


class _Table:
    """A table on disk that grows by rows, which are JSON already."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._before = "[\n"

    def add(self, rows: Iterable[str]) -> None:
        for row in rows:
            self._stream.write(self._before)
            self._stream.write(row)
            self._before = ",\n"

    def end(self) -> None:
        self._stream.write("[]" if self._before == "[\n" else "\n]")


@dataclass(frozen=True)
class _Frames:
    """What one sensor of a scene takes.

    Attributes:
        token: [F].
        time_us: [F] increasing.
        sample: [F] keyframe a frame leads to, as in nuScenes.
        is_key: [F].
    """

    token: list[str]
    time_us: NDArray[np.int64]
    sample: NDArray[np.int64]
    is_key: NDArray[np.bool_]


def write_big_tables(out: Path, scenes: int = NUM_SCENES) -> Path:
    """Write tables that the devkit opens as v1.0-trainval; the folder appears when it is whole.

    Args:
        out: Data root to make.
        scenes: How many scenes, of 40 or 41 keyframes each.

    Raises:
        DataError: If the folder exists or there are not so many scenes.
    """
    names = sorted(official_scenes(VERSION, "train") + official_scenes(VERSION, "val"))
    if not 1 <= scenes <= len(names):
        raise DataError(f"There can be 1 to {len(names)} scenes, not {scenes}.")
    if out.exists():
        raise DataError(f"'{out}' exists already; name a folder that does not.")
    aside = out.with_name(f"{out.name}.partial")
    shutil.rmtree(aside, ignore_errors=True)
    (aside / VERSION).mkdir(parents=True)
    with ExitStack() as stack:
        tables = {}
        for name in _TABLES:
            path = aside / VERSION / f"{name}.json"
            tables[name] = _Table(stack.enter_context(path.open("w", encoding="utf-8")))
            stack.callback(tables[name].end)
        logs = _write_rig_and_logs(tables, aside)
        for row, name in enumerate(names[:scenes]):
            _write_scene(tables, row, name, logs[row * _NUM_LOGS // NUM_SCENES])
    aside.replace(out)
    return out


def _tokens(rng: np.random.Generator, num: int) -> list[str]:
    digits = rng.bytes(16 * num).hex()
    return [digits[start : start + 32] for start in range(0, len(digits), 32)]


def _json(**record: Any) -> str:
    return json.dumps(record, indent=0)


def _write_rig_and_logs(tables: dict[str, _Table], root: Path) -> list[dict[str, str]]:
    """Sensors, logs and the maps that the devkit will not open without; returns the logs."""
    tables["sensor"].add(
        _json(token=_sensor_token(channel), channel=channel, modality=_modality(channel))
        for channel in _RATE_HZ
    )
    logs = [
        {
            "token": token,
            "logfile": f"n{row:03d}-2018-07-24-11-22-45+0800",
            "vehicle": f"n{row:03d}",
            "date_captured": "2018-07-24",
            "location": _LOCATIONS[row % len(_LOCATIONS)],
        }
        for row, token in enumerate(_tokens(np.random.default_rng(1), _NUM_LOGS))
    ]
    tables["log"].add(_json(**log) for log in logs)
    (root / "maps").mkdir()
    for place in _LOCATIONS:
        Image.new("L", (4, 4)).save(root / "maps" / f"{place}.png")
        tables["map"].add(
            [
                _json(
                    category="semantic_prior",
                    token=place,
                    filename=f"maps/{place}.png",
                    log_tokens=[log["token"] for log in logs if log["location"] == place],
                )
            ]
        )
    return logs


def _sensor_token(channel: str) -> str:
    return channel.lower().encode().hex().ljust(32, "0")[:32]


def _modality(channel: str) -> str:
    return {"C": "camera", "L": "lidar", "R": "radar"}[channel[0]]


def _write_scene(tables: dict[str, _Table], row: int, name: str, log: dict[str, str]) -> None:
    rng = np.random.default_rng((2, row))
    # 850 scenes then have 34,149 keyframes.
    num_keyframes = 40 + (row * 149 // NUM_SCENES < (row + 1) * 149 // NUM_SCENES)
    start_us = _T0_US + row * _NUM_LOGS // NUM_SCENES * _LOG_US + row * _SCENE_US
    scene_token, *samples = _tokens(rng, 1 + num_keyframes)
    frames = {channel: _fire(rng, channel, start_us, num_keyframes) for channel in _RATE_HZ}
    lidar = frames["LIDAR_TOP"]
    tables["scene"].add(
        [
            _json(
                token=scene_token,
                log_token=log["token"],
                nbr_samples=num_keyframes,
                first_sample_token=samples[0],
                last_sample_token=samples[-1],
                name=name,
                description="Parked truck, construction, intersection, turn left",
            )
        ]
    )
    around = ["", *samples, ""]
    tables["sample"].add(
        _json(token=token, timestamp=time_us, prev=prev, next=next_, scene_token=scene_token)
        for token, time_us, prev, next_ in zip(
            samples, lidar.time_us[lidar.is_key].tolist(), around, around[2:], strict=False
        )
    )
    drive = _Drive(rng, start_us)
    for channel, taken in frames.items():
        calibration = _write_calibration(tables["calibrated_sensor"], rng, channel)
        of_sample = [samples[i] for i in taken.sample.tolist()]
        tables["sample_data"].add(_data_rows(channel, taken, of_sample, calibration, log))
        tables["ego_pose"].add(drive.pose_rows(taken))


def _fire(rng: np.random.Generator, channel: str, start_us: int, num_keyframes: int) -> _Frames:
    """When a sensor fires in a scene: at its own rate, a little unevenly."""
    rate_hz = _RATE_HZ[channel]
    last_s = (num_keyframes - 1) * _KEYFRAME_S
    frames_s = np.arange(round(last_s * rate_hz) + 1) / rate_hz
    keyframes_s = np.arange(num_keyframes) * _KEYFRAME_S
    key = np.rint(keyframes_s * rate_hz).astype(np.int64).clip(max=len(frames_s) - 1)
    is_key = np.zeros(len(frames_s), dtype=bool)
    is_key[key] = True
    uneven_s = rng.uniform(-0.002, 0.002, len(frames_s))
    time_us = start_us + np.rint((frames_s + uneven_s) * 1e6).astype(np.int64)
    sample = np.searchsorted(key, np.arange(len(frames_s))).clip(max=num_keyframes - 1)
    return _Frames(_tokens(rng, len(frames_s)), time_us, sample, is_key)


def _write_calibration(table: _Table, rng: np.random.Generator, channel: str) -> str:
    (token,) = _tokens(rng, 1)
    focal_px = 1260.0 + rng.normal()
    camera = [[focal_px, 0.0, 816.0 + rng.normal()], [0.0, focal_px, 491.0], [0.0, 0.0, 1.0]]
    # The cameras look all around, each a little off.
    half_rad = np.pi * CAMERAS.index(channel) / len(CAMERAS) if channel in CAMERAS else 0.0
    cos, sin = np.cos(half_rad), np.sin(half_rad)
    rotation = 0.5 * np.asarray([cos + sin, -cos - sin, cos - sin, sin - cos])
    rotation += rng.normal(0.0, 0.01, 4)
    place_m = np.asarray([1.0, 0.0, 1.5]) + rng.normal(0.0, 0.1, 3)
    table.add(
        [
            _json(
                token=token,
                sensor_token=_sensor_token(channel),
                translation=place_m.tolist(),
                rotation=(rotation / np.linalg.norm(rotation)).tolist(),
                camera_intrinsic=camera if channel.startswith("CAM") else [],
            )
        ]
    )
    return token


def _data_rows(
    channel: str, frames: _Frames, samples: list[str], calibration: str, log: dict[str, str]
) -> Iterable[str]:
    kind, height, width = {"C": ("jpg", 900, 1600), "L": ("pcd", 0, 0), "R": ("pcd", 0, 0)}[
        channel[0]
    ]
    ending = "pcd.bin" if channel == "LIDAR_TOP" else kind
    around = ["", *frames.token, ""]
    for token, prev, next_, sample, time_us, is_key in zip(
        frames.token, around, around[2:], samples, frames.time_us.tolist(), frames.is_key.tolist(),
        strict=False,
    ):  # fmt: skip
        yield (
            f'{{\n"token": "{token}",\n"sample_token": "{sample}",\n"ego_pose_token": "{token}",\n'
            f'"calibrated_sensor_token": "{calibration}",\n"timestamp": {time_us},\n'
            f'"fileformat": "{kind}",\n"is_key_frame": {"true" if is_key else "false"},\n'
            f'"height": {height},\n"width": {width},\n"filename": '
            f'"{"samples" if is_key else "sweeps"}/{channel}/{log["logfile"]}__{channel}__{time_us}'
            f'.{ending}",\n"prev": "{prev}",\n"next": "{next_}"\n}}'
        )


class _Drive:
    """A car that goes faster and slower and turns, all smoothly."""

    def __init__(self, rng: np.random.Generator, start_us: int) -> None:
        self._start_us = start_us
        self._time_s = np.arange(-0.1, 21.0, 0.01)
        speed_mps = 6.0 + 4.0 * np.sin(0.3 * self._time_s + rng.uniform(0.0, 6.0))
        turn_radps = rng.uniform(-0.1, 0.1) * np.sin(0.4 * self._time_s + rng.uniform(0.0, 6.0))
        self._yaw_rad = rng.uniform(-3.0, 3.0) + np.cumsum(turn_radps) * 0.01
        direction = np.stack([np.cos(self._yaw_rad), np.sin(self._yaw_rad)])
        self._xy_m = rng.uniform(300.0, 2500.0, (2, 1)) + np.cumsum(
            speed_mps * direction * 0.01, axis=-1
        )
        self._tilt = rng.normal(0.0, 0.01, 2)

    def pose_rows(self, frames: _Frames) -> Iterable[str]:
        at_s = (frames.time_us - self._start_us) / 1e6
        half_rad = np.interp(at_s, self._time_s, self._yaw_rad) / 2.0
        tilt = np.broadcast_to(self._tilt[:, None], (2, len(at_s)))
        rotation = np.stack([np.cos(half_rad), *tilt, np.sin(half_rad)])
        rotation /= np.linalg.norm(rotation, axis=0)
        x_m, y_m = (np.interp(at_s, self._time_s, along_m) for along_m in self._xy_m)
        for token, time_us, rotated, x, y in zip(
            frames.token, frames.time_us.tolist(), rotation.T.tolist(), x_m.tolist(), y_m.tolist(),
            strict=True,
        ):  # fmt: skip
            q0, q1, q2, q3 = rotated
            yield (
                f'{{\n"token": "{token}",\n"timestamp": {time_us},\n"rotation": [\n{q0!r},\n{q1!r},'
                f'\n{q2!r},\n{q3!r}\n],\n"translation": [\n{x!r},\n{y!r},\n0.0\n]\n}}'
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenes", type=int, default=NUM_SCENES)
    arguments = parser.parse_args()
    try:
        print(write_big_tables(arguments.out, arguments.scenes))
    except DataError as error:
        parser.error(str(error))
