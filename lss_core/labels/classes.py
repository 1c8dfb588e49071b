"""The classes of labels, and which annotated objects are of them."""

from collections.abc import Sequence

from lss_core.data.annotations.categories import plain_name
from lss_core.errors import DataError

OBJECT_CLASSES = ("car", "vehicle")
MAP_CLASSES = ("drivable", "lane_boundary")
CLASSES = (*OBJECT_CLASSES, *MAP_CLASSES)
RULES = ("centre", "released")

_CARS = frozenset({"vehicle.car", "car"})
# Lyft names kinds alone. The paper's set has neither its motorcycles nor its emergency vehicles.
_LYFT_VEHICLES = frozenset({"car", "truck", "other_vehicle", "bus", "bicycle"})


def is_of_class(category: str, object_class: str) -> bool:
    """Whether objects of a category of nuScenes or Lyft are of a class, `car` or `vehicle`.

    A vehicle is all that nuScenes calls `vehicle.*`, bicycles and motorcycles among them.

    Paper: section 5.1.
    """
    name = plain_name(category)
    if object_class == "car":
        return name in _CARS
    return name.split(".")[0] == "vehicle" or name in _LYFT_VEHICLES


def check_names(classes: Sequence[str], rule: str) -> None:
    """See whether classes and rule are known.

    Raises:
        DataError: If one is not, a class is asked for twice, or none is.
    """
    for name in classes:
        if name not in CLASSES:
            raise DataError(f"There are no labels '{name}'; choose among {', '.join(CLASSES)}.")
    if not classes or len(set(classes)) < len(classes):
        raise DataError(f"Labels are of one class or more, each once, not of {list(classes)}.")
    if rule not in RULES:
        raise DataError(f"There is no rule '{rule}' for labels; choose among {', '.join(RULES)}.")
