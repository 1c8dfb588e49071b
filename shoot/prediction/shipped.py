"""Where the planner is that comes with the sources, or with an installed wheel."""

import sysconfig
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

_SHIPPED = Path("templates") / "synthetic-1000"
NO_PLANNER_FOR_ROADS = (
    "The shipped planner was trained on a synthetic city; it is no planner for real roads."
)


def shipped_run() -> Path:
    """Its run folder.

    Of a wheel, the installer knows where it has put it: what belongs to no package goes to one of
    several places.
    """
    sources = Path(__file__).parents[2] / _SHIPPED
    if sources.exists():
        return sources
    try:
        installed = files("shoot") or []
    except PackageNotFoundError:
        installed = []
    for file in installed:
        if file.parts[-3:] == (*_SHIPPED.parts, "config.yaml"):
            return Path(file.locate()).resolve().parent
    return Path(sysconfig.get_path("data")) / "share" / "shoot" / _SHIPPED
