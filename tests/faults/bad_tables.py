"""Tables, splits and scenes that are not as they should be, and names of files that lead astray."""

import json
import math
from functools import partial
from pathlib import Path
from typing import Any

from bad_data import (
    BESIDE,
    CAMS,
    TOKEN,
    TRAIN,
    Case,
    Record,
    Spoil,
    change,
    change_frame,
    rewrite,
)
from tiny_tables import VERSION

from lss_core.data.tables.reading import TABLES

_table = partial(Case, "tables")


def text_of(table: str, contents: bytes) -> Spoil:
    return lambda root: (root / VERSION / f"{table}.json").write_bytes(contents)


def recode(table: str, function: Any) -> Spoil:
    def spoil(root: Path) -> None:
        path = root / VERSION / f"{table}.json"
        path.write_bytes(function(path.read_text()))

    return spoil


def _folder(table: str) -> Spoil:
    def spoil(root: Path) -> None:
        (root / VERSION / f"{table}.json").unlink()
        (root / VERSION / f"{table}.json").mkdir()

    return spoil


_CONTENTS: dict[str, bytes] = {
    "empty": b"",
    "blank": b" \n ",
    "null": b"null",
    "an object": b"{}",
    "a number": b"7",
    "list of null": b"[null]",
    "list of numbers": b"[1, 2]",
    "record without columns": b"[{}]",
    "not JSON": b"[not json]",
    "noise": bytes(range(256)),
    "nested without end": b"[" * 100_000,
    "a Git LFS pointer": b"version https://git-lfs.github.com/spec/v1\n",
}

TABLE_CASES = [
    *(
        _table(
            f"{table} is missing",
            lambda root, t=table: (root / VERSION / f"{t}.json").unlink(),
            (f"{table}.json",),
        )
        for table in TABLES.values()
    ),
    *(
        _table(f"{table}: {name}", text_of(table, contents), (f"{table}.json",))
        for table, (name, contents) in zip(
            [table for table in TABLES.values() if table != "sample_data"] * 2,
            _CONTENTS.items(),
            strict=False,
        )
    ),
    *(
        _table(f"sample_data: {name}", text_of("sample_data", contents), ("sample_data.json",))
        for name, contents in _CONTENTS.items()
    ),
    *(
        _table(
            f"{table} is cut off",
            recode(table, lambda text: text[:-40].encode()),
            (f"{table}.json",),
        )
        for table in TABLES.values()
    ),
    *(
        _table(f"{table} has no record", text_of(table, b"[]"), says)
        for table, says in (
            ("scene", ("no scene",)),
            ("sample", ("no scene",)),
            ("log", ("log.json",)),
            ("sensor", ("no sensor",)),
            ("ego_pose", ("ego_pose.json",)),
            ("calibrated_sensor", ("calibrated_sensor.json",)),
        )
    ),
    _table("ego_pose is a folder", _folder("ego_pose"), ("ego_pose.json",)),
    *(
        _table(
            f"{table}.{field} dangles",
            rewrite(table, lambda rs, f=field: [*rs[:-1], rs[-1] | {f: "nobody"}]),
            (f"{other}.json", "'nobody'", f"{table}.json"),
        )
        for table, field, other in (
            ("scene", "log_token", "log"),
            ("sample", "scene_token", "scene"),
            ("sample_data", "sample_token", "sample"),
            ("sample_data", "ego_pose_token", "ego_pose"),
            ("sample_data", "calibrated_sensor_token", "calibrated_sensor"),
            ("calibrated_sensor", "sensor_token", "sensor"),
        )
    ),
    *(
        _table(
            f"{table} has two records of one token",
            rewrite(table, lambda rs: [*rs, rs[0]]),
            (f"{table}.json", "several"),
        )
        for table in ("scene", "sample")
    ),
    *(
        _table(
            f"a token is {name}",
            rewrite("sample", lambda rs, v=value: [rs[0] | {"token": v}, *rs[1:]]),
            ("sample.json",),
        )
        for name, value in (
            ("null", None),
            ("a number", 5),
            ("a list", ["a"]),
            ("300 letters", "a" * 300),
            ("half a pair", "\ud800"),
        )
    ),
    _table("in UTF-16", recode("sample", lambda text: text.encode("utf-16")), None),
    _table("with a byte order mark", recode("sample", lambda text: text.encode("utf-8-sig")), None),
    _table(
        "in Latin-1",
        recode("scene", lambda text: text.replace("Made", "Größe").encode("latin-1")),
        ("scene.json",),
    ),
    _table(
        "a description of a million letters",
        change("scene", f"token-{TRAIN.name}", description="long " * 200_000),
        None,
    ),
    _table(
        "columns that nobody knows",
        rewrite("scene", lambda rs: [r | {"more": [math.nan]} for r in rs]),
        None,
    ),
    _table(
        "a description with half a pair",
        change("scene", f"token-{TRAIN.name}", description="\udc80"),
        ("scene.json",),
    ),
]


def splits(contents: Any) -> Spoil:
    text = contents if isinstance(contents, bytes) else json.dumps(contents).encode()
    return lambda root: (root / VERSION / "splits.json").write_bytes(text)


def _splits_folder(root: Path) -> None:
    (root / VERSION / "splits.json").unlink()
    (root / VERSION / "splits.json").mkdir()


def without(table: str, wanted: Any) -> Spoil:
    return rewrite(table, lambda records: [r for r in records if not wanted(r)])


def _listed_beside(name: str) -> Spoil:
    """Another scene, which the training split has, too."""
    scenes = rewrite("scene", lambda rs: [*rs, rs[0] | {"token": "more", "name": name}])
    lists = splits({"train": [TRAIN.name, BESIDE.name, name], "val": []})
    return lambda root: (scenes(root), lists(root))


def _of_scene(record: Record) -> bool:
    return str(record["token"]).startswith(TRAIN.name)


_scene = partial(Case, "splits and scenes")
_masked = partial(_scene, says=None)

SPLITS = [
    *(
        _scene(f"splits.json: {name}", splits(contents), ("splits.json",))
        for name, contents in (
            ("empty", b""),
            ("a list", ["train"]),
            ("a number", 5),
            ("null", None),
            ("a text", "train"),
            ("a split that is a text", {"train": "scene-0001"}),
            ("a split that is null", {"train": None}),
            ("without the split", {"val": ["scene-0001"]}),
            ("no UTF-8", b'{"train": ["\xff"]}'),
            ("nested without end", b"[" * 100_000),
            ("cut off", b'{"train": ["scene'),
        )
    ),
    _scene("splits.json is a folder", _splits_folder, ("splits.json",)),
    *(
        _scene(f"split {name}", splits({"train": names}), ("'train'",))
        for name, names in (
            ("empty", []),
            ("of unknown scenes", ["scene-9999"]),
            ("of a scene more", ["scene-0001", "scene-0002", "scene-9999"]),
            ("of numbers", [1, 2]),
            ("of lists", [["scene-0001"]]),
            ("of null", [None]),
        )
    ),
    _scene(
        "scenes are longer than half a screen",
        lambda root: rewrite("scene", lambda rs: [r | {"name": "n" * 300} for r in rs])(root),
        ("scene.json",),
    ),
    _scene(
        "no camera of that name",
        rewrite(
            "sensor",
            lambda rs: [r | {"channel": r["channel"].replace(CAMS[0], "CAM_ELSE")} for r in rs],
        ),
        (CAMS[0], "CAM_ELSE"),
    ),
    _scene(
        "a scene without records",
        without("sample_data", _of_scene),
        (f"token-{TRAIN.name}", "sample_data.json"),
        13,
        "scene without poses",
    ),
    _masked(
        "a sample without one camera",
        without(
            "sample_data", lambda r: r["sample_token"] == TOKEN and f"/{CAMS[0]}/" in r["filename"]
        ),
    ),
    _scene(
        "a sample without any camera",
        without("sample_data", lambda r: r["sample_token"] == TOKEN and "/CAM_" in r["filename"]),
        (TOKEN, "no image"),
        1,
        "no image",
    ),
    _masked(
        "a scene without one camera",
        without("sample_data", lambda r: _of_scene(r) and f"/{CAMS[0]}/" in r["filename"]),
    ),
    _masked(
        "a sample without a sweep",
        without(
            "sample_data", lambda r: r["sample_token"] == TOKEN and "samples/LIDAR" in r["filename"]
        ),
    ),
    _scene(
        "a sample without a sweep, for a lidar planner",
        without(
            "sample_data", lambda r: r["sample_token"] == TOKEN and "samples/LIDAR" in r["filename"]
        ),
        (TOKEN, "no lidar sweep"),
        1,
        "no lidar sweep",
        lidar=1,
    ),
    _masked(
        "a scene without lidar",
        without("sample_data", lambda r: _of_scene(r) and "/LIDAR" in r["filename"]),
        used=5,  # the last camera fires a little before the last sweep was
    ),
    _masked(
        "a scene without samples beside",
        _listed_beside("scene-0004"),
    ),
    _masked(
        "a scene of one sample beside",
        lambda root: (
            _listed_beside("scene-0004")(root),
            rewrite("sample", lambda rs: [*rs, rs[0] | {"token": "one", "scene_token": "more"}])(
                root
            ),
            rewrite(
                "sample_data",
                lambda rs: [
                    *rs,
                    *(
                        r | {"token": f"one-{n}", "sample_token": "one"}
                        for n, r in enumerate(rs)
                        if r["sample_token"] == f"{TRAIN.name}-00"
                    ),
                ],
            )(root),
        ),
    ),
    # Of the other scene a second is left: too short for a future, as documented.
    _scene(
        "a scene shorter than the horizon",
        without(
            "sample_data",
            lambda r: (
                r["token"].startswith((TRAIN.name, BESIDE.name)) and int(r["sample_token"][-2:]) > 2
            ),
        ),
        ("'train'", "5 s"),
    ),
]

_name = partial(Case, "file names")
OUTSIDE = "outside"  # a folder beside the data root that no command may look into
_ASTRAY: dict[str, str] = {
    "absolute": f"/{OUTSIDE}/image.jpg",
    "of passwords": "/etc/passwd",
    "of a device": "/dev/zero",
    "the folder above": "..",
    "above": f"../{OUTSIDE}/image.jpg",
    "above from within": f"samples/../../{OUTSIDE}/image.jpg",
    "far above": "../" * 20 + "etc/passwd",
    "above at its end": "samples/..",
    "with two slashes first": f"//{OUTSIDE}/image.jpg",
    "with a backslash": f"..\\{OUTSIDE}\\image.jpg",
    "of another system": "C:\\windows\\system.ini",
    "with NUL": "samples/\x00.jpg",
    "with a line break": "samples/a\nerror: all is well.jpg",
    "that steers a terminal": "samples/\x1b[2J\x1b]0;title\x07.jpg",
    "with a return": "samples/\r.jpg",
    "with DEL": "samples/\x7f.jpg",
    "with a control of Latin-1": "samples/\x9b31m.jpg",
    "with half a pair": "samples/\ud800.jpg",
    "of 1025 letters": "a" * 1025,
}

NAMES = [
    *(
        _name(
            f"{name}, of {what}",
            change_frame("sample_data", channel, filename=value),
            ("sample_data.json",),
            lidar=lidar,
        )
        for name, value in _ASTRAY.items()
        for what, channel, lidar in (("an image", CAMS[0], 0), ("a sweep", "LIDAR_TOP", 1))
    ),
    *(
        _name(
            f"{name}, between keyframes",
            rewrite(
                "sample_data",
                lambda rs, v=value: [
                    r | {"filename": v} if r["filename"].startswith("sweeps") else r for r in rs
                ],
            ),
            ("sample_data.json",),
        )
        for name, value in list(_ASTRAY.items())[:6]
    ),
    *(
        _name(
            f"{name}, of an image",
            change_frame("sample_data", CAMS[0], filename=value),
            (TOKEN, "missing"),
            1,
            "missing image",
        )
        for name, value in (
            ("empty", ""),
            ("a dot", "."),
            ("a folder's", "samples"),
            ("of nothing", "samples/no.jpg"),
            ("with dots that are none", "samples/..a/b...jpg"),
            ("of 300 letters", "a" * 300),
            ("with a tilde", "~/image.jpg"),
            ("with a percent", "%2e%2e/image.jpg"),
            ("of another script", "samples/画像 ü.jpg"),
            ("of a web page", "https:/host/image.jpg"),
        )
    ),
    *(
        _name(
            f"{name}", change_frame("sample_data", CAMS[0], filename=value), ("sample_data.json",)
        )
        for name, value in (("null", None), ("a number", 5), ("a list", ["a.jpg"]), ("absent", ...))
    ),
]
