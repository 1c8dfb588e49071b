"""Values as JSON that every parser reads: it knows no NaN, which becomes null."""

import json
import math
from pathlib import Path
from typing import Any

from lss_core.files import write_atomically


def without_nan(value: Any) -> Any:
    """Dicts and lists as they are, tuples as lists, and None for numbers that are not finite."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def save_json(value: Any, path: str | Path) -> None:
    """Write a file that appears whole or not at all.

    Raises:
        OSError: If it cannot be written.
    """
    text = json.dumps(without_nan(value), indent=2, allow_nan=False) + "\n"
    with write_atomically(path) as stream:
        stream.write(text.encode())
