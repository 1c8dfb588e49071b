"""What collision and off-road rates rest on, and why they are left out where they are."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

_NAMED = 4


@dataclass(frozen=True)
class CheckBasis:
    """What the checks of paths know of some samples.

    Attributes:
        num_samples: Samples.
        num_samples_with_boxes: Those whose scenes have annotations of known categories, and tracks.
        num_samples_on_road: Those with a map where the car itself stands on drivable area.
        num_samples_with_map: Those with a map that has drivable area.
        boxes: Category -> objects that paths may collide with.
        unknown: Category -> annotations that do not count, since nobody knows the name.
        no_collisions: Why there are no collision rates; empty where there are.
        no_off_road: Why there are no off-road rates; empty where there are.
    """

    num_samples: int
    num_samples_with_boxes: int = 0
    num_samples_on_road: int = 0
    num_samples_with_map: int = 0
    boxes: dict[str, int] = field(default_factory=dict)
    unknown: dict[str, int] = field(default_factory=dict)
    no_collisions: str = ""
    no_off_road: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain values; a rate that is there has null instead of a reason."""
        values = asdict(self)
        for name in ("no_collisions", "no_off_road"):
            values[name] = values[name] or None
        return values

    def sentences(self) -> tuple[str, str]:
        """For people: of collisions, and of leaving the road."""
        if self.no_collisions:
            collisions = f"collisions: {self.no_collisions}, left out"
        else:
            collisions = (
                f"collisions rest on {sum(self.boxes.values())} objects"
                f"{_bracketed(self.boxes)}, at {self.num_samples_with_boxes} of "
                f"{self.num_samples} samples"
            )
            if self.unknown:
                what = f"{sum(self.unknown.values())} annotations of unknown categories"
                collisions += f"; {what}{_bracketed(self.unknown)} do not count"
        if self.no_off_road:
            return collisions, f"off-road: {self.no_off_road}, left out"
        return collisions, (
            f"off-road rates rest on maps at {self.num_samples_with_map} of {self.num_samples} "
            f"samples; the car itself is on drivable area at {self.num_samples_on_road} of these"
        )


def _bracketed(counts: Mapping[str, int]) -> str:
    named = [f"{name} {num}" for name, num in list(counts.items())[:_NAMED]]
    more = ["..."] if len(counts) > _NAMED else []
    return f" ({', '.join(named + more)})" if counts else ""
