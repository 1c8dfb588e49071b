"""Calibrations and poses that cannot be."""

import math
from functools import partial
from pathlib import Path
from typing import Any

from bad_data import CAMS, TOKEN, TRAIN, Case, Record, Spoil, change, change_frame, rewrite

NAN, INF = math.nan, math.inf
CALIBRATION = f"{TRAIN.name}-{CAMS[0]}"
LIDAR_CALIBRATION = f"{TRAIN.name}-LIDAR_TOP"
K = [[50.0, 0.0, 32.0], [0.0, 50.0, 18.0], [0.0, 0.0, 1.0]]


def k(row: int, column: int, value: float) -> list[list[float]]:
    """Intrinsics with another number somewhere."""
    rows = [list(line) for line in K]
    rows[row][column] = value
    return rows


_INTRINSICS: dict[str, Any] = {
    "NaN focal length": k(0, 0, NAN),
    "infinite focal length": k(1, 1, INF),
    "NaN centre": k(0, 2, NAN),
    "focal length 0": k(0, 0, 0.0),
    "negative focal length": k(1, 1, -50.0),
    "focal length 1e-30": k(0, 0, 1e-30),
    "focal length 1e30": k(0, 0, 1e30),
    "centre 1e30": k(1, 2, 1e30),
    "last row of zeros": [*K[:2], [0.0, 0.0, 0.0]],
    "last row doubled": [*K[:2], [0.0, 0.0, 2.0]],
    "transposed": [list(column) for column in zip(*K, strict=True)],
    "all zeros": [[0.0] * 3] * 3,
    "singular": [[50.0, 50.0, 0.0], [50.0, 50.0, 0.0], [0.0, 0.0, 1.0]],
    "empty": [],
    "null": None,
    "absent": ...,
    "two rows": K[:2],
    "3 x 4": [[*line, 0.0] for line in K],
    "4 x 4": [*([*line, 0.0] for line in K), [0.0, 0.0, 0.0, 1.0]],
    "ragged": [K[0], K[1][:2], K[2]],
}
_ROTATIONS: dict[str, list[float]] = {
    "zero": [0.0] * 4,
    "NaN": [1.0, NAN, 0.0, 0.0],
    "infinite": [INF, 0.0, 0.0, 0.0],
    "of length 2": [2.0, 0.0, 0.0, 0.0],
    "of length 1.02": [1.02, 0.0, 0.0, 0.0],
    "of length 0.98": [0.0, 0.98, 0.0, 0.0],
    "of length 1e-30": [1e-30, 0.0, 0.0, 0.0],
    "of length 1e200": [1e200, 1e200, 0.0, 0.0],
}
_PLACES: dict[str, list[float]] = {
    "NaN": [NAN, 0.0, 0.0],
    "infinite": [0.0, -INF, 0.0],
    "1e9 away": [0.0, 0.0, 1e9],
    "1e300 away": [1e300, 0.0, 0.0],
}
# Not of the kind the table has: it is refused as a whole.
_OTHER_KINDS: dict[str, Any] = {
    "a text": "north",
    "null": None,
    "two numbers": [1.0, 2.0],
    "five numbers": [1.0, 0.0, 0.0, 0.0, 0.0],
    "texts": ["a", "b", "c", "d"],
    "an object": {"x": 1.0},
    "absent": ...,
    "10**400": [10**400, 0, 0, 0],
}

_bad = partial(Case, "calibrations", skipped=3, reason="impossible calibration")
_in_table = partial(Case, "calibrations")

CALIBRATIONS = [
    *(
        _bad(
            f"intrinsics: {name}",
            change("calibrated_sensor", CALIBRATION, camera_intrinsic=value),
            (CALIBRATION, "camera_intrinsic"),
        )
        for name, value in _INTRINSICS.items()
    ),
    *(
        _bad(
            f"rotation: {name}",
            change("calibrated_sensor", CALIBRATION, rotation=value),
            (CALIBRATION, "rotation"),
        )
        for name, value in _ROTATIONS.items()
    ),
    *(
        _bad(
            f"translation: {name}",
            change("calibrated_sensor", CALIBRATION, translation=value),
            (CALIBRATION, "translation"),
        )
        for name, value in (*_PLACES.items(), ("101 m away", [101.0, 0.0, 0.0]))
    ),
    *(
        _bad(
            f"lidar's {field}: {name}",
            change("calibrated_sensor", LIDAR_CALIBRATION, **{field: value}),
            (LIDAR_CALIBRATION, field),
            lidar=1,
        )
        for field, values in (("rotation", _ROTATIONS), ("translation", _PLACES))
        for name, value in list(values.items())[:3]
    ),
    *(
        _in_table(
            f"{field}: {name}",
            change("calibrated_sensor", CALIBRATION, **{field: value}),
            ("calibrated_sensor.json", field if value is ... else "$["),
        )
        for field in ("rotation", "translation")
        for name, value in _OTHER_KINDS.items()
    ),
    _in_table(
        "camera_intrinsic: texts",
        change("calibrated_sensor", CALIBRATION, camera_intrinsic=[["a"] * 3] * 3),
        ("calibrated_sensor.json",),
    ),
    # To within rounding: it is made a turn.
    _in_table(
        "rotation: of length 1.005",
        change("calibrated_sensor", CALIBRATION, rotation=[0.5025, -0.5025, 0.5025, -0.5025]),
        None,
    ),
    # Nobody reads it here.
    _in_table(
        "lidar's of a planner with cameras",
        change("calibrated_sensor", LIDAR_CALIBRATION, rotation=[0.0] * 4),
        None,
    ),
    _in_table(
        "a camera's of a planner with lidar",
        change("calibrated_sensor", CALIBRATION, camera_intrinsic=[]),
        None,
        lidar=1,
    ),
]


def sweeps(function: Any) -> Spoil:
    """Change the sweeps of the first training scene, given in the order of their time."""

    def change_all(records: list[Record]) -> list[Record]:
        own = [r for r in records if r["filename"].split("/")[1] == "LIDAR_TOP"]
        own = [r for r in own if r["token"].startswith(TRAIN.name)]
        others = [r for r in records if r not in own]
        return others + function(own)

    return rewrite("sample_data", change_all)


def times(function: Any) -> Spoil:
    """Other time stamps: a function of number and stamp."""
    return sweeps(
        lambda own: [
            record | {"timestamp": function(number, record["timestamp"])}
            for number, record in enumerate(own)
        ]
    )


def move(number: int, **values: Any) -> Spoil:
    """Give the pose of a sweep of the first scene other values."""

    def spoil(root: Path) -> None:
        tokens: list[str] = []
        sweeps(lambda own: tokens.append(own[number]["ego_pose_token"]) or own)(root)
        change("ego_pose", tokens[0], **values)(root)

    return spoil


# All 13 keyframes of the scene are listed: futures are made of all its poses.
_scene = partial(Case, "poses", skipped=13)
_pose = partial(_scene, reason="impossible pose")
_time = partial(_scene, reason="impossible time stamp")
_step = partial(_scene, reason="impossible motion")
_camera = partial(Case, "poses", skipped=1)

POSES = [
    *(
        _pose(
            f"{field} of sweep {number}: {name}",
            move(number, **{field: value}),
            ("ego_pose.json", f"{TRAIN.name}-LIDAR_TOP", field),
        )
        for number, field, values in (
            (17, "rotation", _ROTATIONS),
            (0, "translation", _PLACES),
            (60, "rotation", _ROTATIONS),
        )
        for name, value in list(values.items())[: 8 if number == 17 else 4]
    ),
    *(
        Case("poses", f"{field}: {name}", move(17, **{field: value}), ("ego_pose.json",))
        for field in ("rotation", "translation")
        for name, value in list(_OTHER_KINDS.items())[:: 2 if field == "rotation" else 3]
    ),
    *(
        _step(
            f"a leap of {leap:g} m at sweep {number}",
            move(number, translation=[TRAIN.x_m + leap, TRAIN.y_m, 0.0]),
            ("ego_pose.json", "apart"),
        )
        for number in (1, 30, 60)
        for leap in (-100.0, 5000.0)
    ),
    *(
        _camera(
            f"a camera's {name}",
            change_frame("ego_pose", CAMS[0], **values),
            ("ego_pose.json", f"{TRAIN.name}-{CAMS[0]}"),
            reason=reason,
        )
        for name, values, reason in (
            ("pose is NaN", {"translation": [NAN] * 3}, "impossible pose"),
            ("pose turns by nothing", {"rotation": [0.0] * 4}, "impossible pose"),
            ("pose is 100 m away", {"translation": [500.0, 900.0, 0.0]}, "impossible motion"),
            ("pose is at the origin", {"translation": [0.0] * 3}, "impossible motion"),
        )
    ),
    *(
        _camera(
            f"a camera's time is {stamp}",
            change_frame("sample_data", CAMS[0], timestamp=stamp),
            (f"{TRAIN.name}-{CAMS[0]}",),
            reason=reason,
        )
        for stamp, reason in (
            (NAN, "impossible time stamp"),
            (INF, "impossible time stamp"),
            (1e18, "impossible time stamp"),
            (0, "gap in time"),
            (1_532_406_527_000_000, "gap in time"),
        )
    ),
    *(
        _time(
            f"time of sweep 20 is {stamp}",
            times(lambda number, old, stamp=stamp: stamp if number == 20 else old),
            ("sample_data.json", f"{TRAIN.name}-LIDAR_TOP"),
        )
        for stamp in (NAN, INF, -INF, 1e17, -1e17)
    ),
    _time("time in nanoseconds", times(lambda _, old: old * 1000), ("sample_data.json",)),
    _step("time in milliseconds", times(lambda _, old: old // 1000), ("ego_pose.json",)),
    *(
        _scene(
            f"sweep {number} an hour {word}",
            times(lambda n, old, number=number, by=by: old + by if n == number else old),
            ("ego_pose.json", "s apart"),
            reason="gap in time",
        )
        for number, word, by in ((60, "late", 3_600_000_000), (0, "early", -3_600_000_000))
    ),
    _scene(
        "three seconds lost",
        sweeps(lambda own: own[:20] + own[50:]),
        ("ego_pose.json", "s apart"),
        reason="gap in time",
    ),
    *(
        Case(
            "poses",
            f"time of a sweep: {name}",
            times(lambda n, old, v=value: v if n == 7 else old),
            ("sample_data.json",),
        )
        for name, value in (("text", "noon"), ("null", None), ("a list", [1]), ("10**400", 10**400))
    ),
    Case(
        "poses",
        "dangling",
        sweeps(lambda own: [own[0] | {"ego_pose_token": "x"}, *own[1:]]),
        ("ego_pose.json", "'x'"),
    ),
    # Handled.
    Case("poses", "in another order", sweeps(lambda own: own[::-1]), None),
    Case("poses", "in no order", sweeps(lambda own: own[1::2] + own[::2]), None),
    Case(
        "poses",
        "doubled, 0 s apart",
        sweeps(
            lambda own: own + [r | {"token": r["token"] + "b", "is_key_frame": False} for r in own]
        ),
        None,
    ),
    Case("poses", "at fractions of microseconds", times(lambda _, old: old + 0.25), None),
    Case("poses", "half a second lost", sweeps(lambda own: [*own[:32], *own[35:]]), None),
    Case(
        "poses",
        "of radars that nobody reads",
        rewrite(
            "ego_pose",
            lambda rs: [*rs, {"token": "r", "rotation": [0.0] * 4, "translation": [NAN] * 3}],
        ),
        None,
    ),
]

# The samples' own times are used only where there is no sweep.
SAMPLE_TIMES = [
    Case(
        "poses",
        f"time of a sample with a sweep is {stamp}",
        change("sample", TOKEN, timestamp=stamp),
        None,
    )
    for stamp in (NAN, 0, 1e30)
] + [
    _time(
        "time of a sample without a sweep",
        lambda root: (
            change("sample", TOKEN, timestamp=NAN)(root),
            sweeps(
                lambda own: [r for r in own if r["sample_token"] != TOKEN or not r["is_key_frame"]]
            )(root),
        ),
        ("sample.json", TOKEN),
    ),
]
POSES += SAMPLE_TIMES
