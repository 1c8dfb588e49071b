"""Where the planner and the example are that come with the sources, or with an installed wheel."""

import sysconfig
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

NO_PLANNER_FOR_ROADS = (
    "The shipped planner was trained on a synthetic city; it is no planner for real roads."
)


def shipped_run() -> Path:
    """Run folder of the shipped planner."""
    return shipped_folder("synthetic-1000", "config.yaml")


def shipped_folder(name: str, file_in_it: str) -> Path:
    """A folder of `templates/`.

    Of a wheel, the installer knows where it has put it: what belongs to no package goes to one of
    several places.
    """
    folder = Path("templates") / name
    sources = Path(__file__).parents[2] / folder
    if sources.exists():
        return sources
    try:
        installed = files("shoot-planner") or []
    except PackageNotFoundError:
        installed = []
    for file in installed:
        if file.parts[-3:] == (*folder.parts, file_in_it):
            return Path(file.locate()).resolve().parent
    return Path(sysconfig.get_path("data")) / "share" / "shoot" / folder
