"""Which scenes belong to which split: nuScenes' own lists, or a `splits.json` beside the tables."""

import json
from pathlib import Path
from typing import Any

from lss_core.errors import DataError

# The devkit's lists are global; only these belong to each version.
_SPLITS_OF_VERSION = {
    "v1.0-trainval": ("train", "val", "train_detect", "train_track"),
    "v1.0-mini": ("mini_train", "mini_val"),
    "v1.0-test": ("test",),
}
_OWN = "splits.json"
_FORM = "'{}' must be a JSON object of split names and lists of scene names"
_MINI_NAMES = {"train": "mini_train", "val": "mini_val"}


def official_scenes(version: str, split: str) -> tuple[str, ...]:
    """Names of the scenes of an official nuScenes split.

    `train` and `val` of v1.0-mini mean `mini_train` and `mini_val`. Versions the devkit does not
    know (as Lyft's) use the lists of v1.0-trainval.

    Raises:
        DataError: If the version has no such split.
    """
    if version == "v1.0-mini":
        split = _MINI_NAMES.get(split, split)
    known = _SPLITS_OF_VERSION.get(version, _SPLITS_OF_VERSION["v1.0-trainval"])
    if split not in known:
        raise DataError(f"Unknown split '{split}' of {version}; known are {', '.join(known)}.")
    # Takes a second and is not needed where there is a `splits.json`.
    from nuscenes.utils.splits import create_splits_scenes

    return tuple(create_splits_scenes()[split])


def has_own_splits(version_folder: Path) -> bool:
    """Whether a data set lists its splits itself."""
    return (version_folder / _OWN).exists()


def scenes_of_split(version_folder: Path, split: str) -> tuple[str, ...]:
    """Names of the scenes of a split; a `splits.json` (name -> scenes) in the folder overrides.

    Raises:
        DataError: If the split is unknown or `splits.json` is not what it should be.
    """
    splits = _own_splits(version_folder)
    if splits is None:
        return official_scenes(version_folder.name, split)
    override = version_folder / _OWN
    if split not in splits:
        known = ", ".join(sorted(splits))
        raise DataError(f"Unknown split '{split}'; {override} knows {known}.")
    names = splits[split]
    if not isinstance(names, list):
        raise DataError(f"{_FORM.format(override)}: '{split}' is no list")
    return tuple(str(name) for name in names)


def split_names(version_folder: Path) -> tuple[str, ...]:
    """Names of the splits of a `splits.json`, else of the official ones that share no scene.

    Raises:
        DataError: If `splits.json` is not what it should be.
    """
    splits = _own_splits(version_folder)
    if splits is None:
        version = version_folder.name
        return _SPLITS_OF_VERSION.get(version, _SPLITS_OF_VERSION["v1.0-trainval"])[:2]
    return tuple(name for name, scenes in splits.items() if isinstance(scenes, list))


def _own_splits(version_folder: Path) -> dict[str, Any] | None:
    """What a `splits.json` says, if there is one."""
    if not has_own_splits(version_folder):
        return None
    override = version_folder / _OWN
    try:
        splits = json.loads(override.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"The splits '{override}' cannot be read: {error.strerror}.") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{_FORM.format(override)}: {error}") from error
    if not isinstance(splits, dict):
        raise DataError(f"{_FORM.format(override)}: it is no object")
    return splits
