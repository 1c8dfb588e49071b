"""The folder of results: its settings, one file a route, and pictures of it."""

import json
from pathlib import Path
from typing import Any

from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.strict_json import save_json, without_nan

SETTINGS, ROUTES, SUMMARY = "settings.json", "routes", "summary.json"
STRIPS, VIDEOS = "strips", "videos"

Row = dict[str, Any]


def route_file(folder: Path, route: int) -> Path:
    """Where the result of a route is, by its number."""
    return folder / ROUTES / f"route-{route:04d}.json"


def strip_file(folder: Path, route: int) -> Path:
    """Where its filmstrip is."""
    return folder / STRIPS / f"route-{route:04d}.jpg"


def video_file(folder: Path, route: int) -> Path:
    """Where its video is, if it has one."""
    return folder / VIDEOS / f"route-{route:04d}.mp4"


def settle_settings(folder: Path, card: Row) -> None:
    """Compare a folder's settings with those of now; note them in a new one.

    Raises:
        DataError: If they differ.
    """
    path = folder / SETTINGS
    if not path.exists():
        if (folder / ROUTES).exists():
            raise DataError(f"'{folder}' holds routes without {SETTINGS}; name another folder.")
        save_json(card, path)
        return
    before = read_object(path)
    for name in {**card, **before}:
        if before.get(name) != card.get(name):
            raise DataError(
                f"'{folder}' was begun with {name} = {before.get(name)}, now it is "
                f"{card.get(name)}: use the same settings to go on, or another folder."
            )


def write_row(path: Path, row: Row) -> None:
    """Write a result; the file is there whole or not at all."""
    text = json.dumps(without_nan(row), allow_nan=False, separators=(",", ":")) + "\n"
    with write_atomically(path) as stream:
        stream.write(text.encode())


def read_object(path: Path) -> Row:
    """A JSON object.

    Raises:
        DataError: If there is none.
    """
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"'{path}' cannot be read ({error}).") from error
    if not isinstance(value, dict):
        raise DataError(f"'{path}' is no JSON object.")
    return value
