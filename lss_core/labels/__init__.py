"""What is around the car, cell by cell: labels from annotated boxes and the map (section 5.1)."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lss_core.labels.classes import CLASSES, RULES
    from lss_core.labels.reader import LabelReader, sample_labels

__all__ = ["CLASSES", "RULES", "LabelReader", "sample_labels"]


def __getattr__(name: str) -> Any:
    """What the room hands on, loaded when asked for: names of classes need no shapes."""
    if name in ("CLASSES", "RULES"):
        from lss_core.labels import classes

        return getattr(classes, name)
    if name in ("LabelReader", "sample_labels"):
        from lss_core.labels import reader

        return getattr(reader, name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
