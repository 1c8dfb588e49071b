"""Recordings of any car as a data set: poses, cameras and images in, nuScenes tables out."""

import io
import json
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from lss_core.data.checks.recording import Numbers
from lss_core.data.writing.placed_files import place_bytes
from lss_core.data.writing.scene_rows import LIDAR, POSES, scene_rows, scene_token
from lss_core.data.writing.scene_writer import SceneWriter, check_name
from lss_core.data.writing.table_rows import Row, token, write_tables
from lss_core.errors import DataError
from lss_core.files import sole_writer, write_atomically

# The devkit opens no version without a picture of a map.
_NO_MAP = "maps/none.png"
_MODALITIES = {LIDAR: "lidar", POSES: "pose"}


class _Drive(NamedTuple):
    """Where a scene is from."""

    log: str
    location: str
    description: str


class TablesWriter:
    """Writes a version of a data set that `load_index` reads and the official devkit opens.

    Sensor files are put into `samples/` and `sweeps/` as they are added; the tables appear at the
    end, all at once. The same additions give the same bytes.

    Args:
        root: Folder of the data set, which need not be there.
        version: Name of the tables' folder, which must not.

    Raises:
        DataError: If it is, or cannot be; all methods' errors are the same: what cannot be is
            refused when it is added.
    """

    def __init__(self, root: str | Path, version: str = "v1.0-trainval") -> None:
        self._root = Path(root)
        self._version = check_name(version, "version")
        self._scenes: dict[str, SceneWriter] = {}
        self._drives: dict[str, _Drive] = {}
        self._check_new()

    def add_scene(
        self,
        name: str,
        time_s: Numbers,
        global_from_ego: Numbers,
        log: str = "",
        location: str = "",
        description: str = "",
    ) -> SceneWriter:
        """A new scene, to add sensors and keyframes to.

        Args:
            name: Its own in this data set.
            time_s: [P] times of the car's poses in seconds, increasing.
            global_from_ego: [P, 4, 4] the car at these times: x forward, y left, z up, metres.
                All of them are its path; a keyframe needs poses for the 5 s after it.
            log: The drive it was cut from, if there are several scenes of one; else its own name.
            location: Of the drive; names the map, if there is one.
            description: For people.
        """
        if name in self._scenes:
            raise DataError(f"There are two scenes '{name}'; each must have a name of its own.")
        drive = _Drive(log or name, location, description)
        others = (other for other in self._drives.values() if other.log == drive.log)
        if any(other.location != location for other in others):
            raise DataError(f"The log '{drive.log}' is at two locations; make it two logs.")
        scene = SceneWriter(self._root, name, time_s, global_from_ego)
        self._scenes[name], self._drives[name] = scene, drive
        return scene

    def write(self, splits: Mapping[str, Sequence[str]]) -> Path:
        """Write all tables and `splits.json`.

        Args:
            splits: Names of scenes by split, as `train` and `val`; no scene is in two.

        Returns:
            The version's folder.

        Raises:
            OSError: If they cannot be written.
        """
        self._check_new()
        self._check_splits(splits)
        empty = [name for name, one in self._scenes.items() if not one.recording.keyframes_us]
        if empty:
            raise DataError(f"Scene '{empty[0]}' has no keyframe; add some, or leave it out.")
        folder, aside = self._root / self._version, self._root / f".{self._version}.part"
        with sole_writer(self._root):
            shutil.rmtree(aside, ignore_errors=True)
            try:
                place_bytes(_black_png(), self._root, _NO_MAP)
                write_tables(aside, self._tables())
                with write_atomically(aside / "splits.json") as stream:
                    listed = {split: list(names) for split, names in splits.items()}
                    stream.write((json.dumps(listed, indent=2) + "\n").encode())
                aside.rename(folder)
            except BaseException:
                shutil.rmtree(aside, ignore_errors=True)
                raise
        return folder

    def _check_new(self) -> None:
        folder = self._root / self._version
        if folder.exists():
            raise DataError(f"'{folder}' is there already; remove it, or name another folder.")

    def _check_splits(self, splits: Mapping[str, Sequence[str]]) -> None:
        if not splits:
            raise DataError("There are no splits; name at least the scenes of 'train' and 'val'.")
        for split, names in splits.items():
            if isinstance(names, str) or not names:
                raise DataError(f"Split '{split}' must be a list of one or more scenes.")
            unknown = [name for name in names if name not in self._scenes]
            if unknown:
                raise DataError(f"Split '{split}' has scene '{unknown[0]}', which was not added.")
        counts = Counter(name for names in splits.values() for name in names)
        name, count = max(counts.items(), key=lambda item: item[1])
        if count > 1:
            own = [split for split, names in splits.items() if name in names]
            raise DataError(f"Scene '{name}' is {count} times in splits: {', '.join(own)}.")

    def _tables(self) -> dict[str, list[Row]]:
        tables: dict[str, list[Row]] = {"scene": []}
        for name, scene in self._scenes.items():
            own = scene_rows(scene.recording)
            for table, rows in own.items():
                tables.setdefault(table, []).extend(rows)
            samples, drive = own["sample"], self._drives[name]
            tables["scene"].append({
                "token": scene_token(scene.recording),
                "log_token": token("log", drive.log),
                "name": name,
                "description": drive.description,
                "nbr_samples": len(samples),
                "first_sample_token": samples[0]["token"],
                "last_sample_token": samples[-1]["token"],
            })  # fmt: skip
        return tables | self._shared_tables()

    def _shared_tables(self) -> dict[str, list[Row]]:
        """Rows of sensors, categories, logs and the map, which several scenes may have."""
        recordings = [scene.recording for scene in self._scenes.values()]
        channels = dict.fromkeys(channel for r in recordings for channel in r.mountings)
        if any(LIDAR not in recording.mountings for recording in recordings):
            channels[POSES] = None
        categories = dict.fromkeys(
            box.category for r in recordings for own in r.boxes.values() for box in own.values()
        )
        logs = {drive.log: drive.location for drive in self._drives.values()}
        return {
            "sensor": [
                {
                    "token": token("sensor", channel),
                    "channel": channel,
                    "modality": _MODALITIES.get(channel, "camera"),
                }
                for channel in channels
            ],
            "category": [
                {"token": token("category", name), "name": name, "description": ""}
                for name in categories
            ],
            "log": [
                {
                    "token": token("log", log),
                    "logfile": log,
                    "vehicle": "",
                    "date_captured": "",
                    "location": location,
                }
                for log, location in logs.items()
            ],
            "map": [
                {
                    "token": token("map"),
                    "category": "semantic_prior",
                    "filename": _NO_MAP,
                    "log_tokens": [token("log", log) for log in logs],
                }
            ],
        }


def _black_png() -> bytes:
    stream = io.BytesIO()
    Image.new("L", (1, 1)).save(stream, "PNG")
    return stream.getvalue()
