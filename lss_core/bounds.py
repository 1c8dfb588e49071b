"""What settings may be: bounds beside a field's type, held when its dataclass is made."""

from dataclasses import dataclass, fields
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from lss_core.errors import DataError

MAX_SEED = 2**32 - 1  # of numpy's and scikit-learn's
MAX_COUNT = 1_000_000_000


class SettingError(DataError, ValueError):
    """A setting is none, or does not fit the others; one sentence that names it and what may be."""


@dataclass(frozen=True)
class Bounds:
    """Numbers that a field may hold, as `Annotated[float, Bounds(0.0, 1.0)]`; each one of a tuple.

    Attributes:
        low: Smallest.
        high: Greatest.
        low_is_in: Whether `low` itself may be.
    """

    low: int | float
    high: int | float
    low_is_in: bool = True

    def hold(self, number: Any) -> bool:
        """Whether a number lies within; what is no number does not."""
        above = number >= self.low if self.low_is_in else number > self.low
        return bool(above and number <= self.high)

    def __str__(self) -> str:
        low, high = (f"{number:,.10g}" for number in (self.low, self.high))
        return f"lie in {low} to {high}" if self.low_is_in else f"be more than {low}, up to {high}"


Count = Annotated[int, Bounds(1, MAX_COUNT)]
Seed = Annotated[int, Bounds(0, MAX_SEED)]
Workers = Annotated[int, Bounds(1, 1024)]


def check_settings(settings: Any) -> None:
    """Hold a dataclass of settings to the types and bounds of its fields.

    Numbers must lie within their `Bounds` and be whole where the type is `int`; texts must not be
    empty; what is one of several must be one of them.

    Raises:
        SettingError: If one is not so.
    """
    for name, hint in hints_of(settings.__class__).items():
        value = getattr(settings, name)
        wanted = _what_is_wanted(value, hint)
        if wanted is not None:
            raise SettingError(f"{name} is {_shown(value)}, but must {wanted}.")


@cache
def hints_of(settings_type: Any) -> dict[str, Any]:
    """Fields of a dataclass with their types, bounds included."""
    hints = get_type_hints(settings_type, include_extras=True)
    return {one.name: hints[one.name] for one in fields(settings_type)}


def _what_is_wanted(value: Any, hint: Any, bounds: Bounds | None = None) -> str | None:
    """What a value must do to be of a type and within bounds; None if it is."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        own = next((extra for extra in hint.__metadata__ if isinstance(extra, Bounds)), bounds)
        return _what_is_wanted(value, arguments[0], own)
    if origin in (Union, UnionType):
        if value is None and NoneType in arguments:
            return None
        wanted = [_what_is_wanted(value, one, bounds) for one in arguments if one is not NoneType]
        return None if None in wanted else " or ".join(filter(None, wanted))
    if origin is Literal:
        return None if value in arguments else f"be one of {', '.join(map(str, arguments))}"
    if origin is tuple:
        parts = value if isinstance(value, tuple | list) else ()
        if arguments[-1] is not Ellipsis and len(parts) != len(arguments):
            return f"be {len(arguments)} numbers"
        wanted = [_what_is_wanted(part, arguments[0], bounds) for part in parts]
        return next(filter(None, wanted), None)
    if hint in (int, float):
        return _what_is_wanted_of_number(value, hint is int, bounds)
    if hint is str:
        is_text = isinstance(value, str) and value.strip() and "\0" not in value
        return None if is_text else "be a text that is not empty"
    return None if isinstance(value, hint) else f"be a {hint.__name__}"


def _what_is_wanted_of_number(value: Any, whole: bool, bounds: Bounds | None) -> str | None:
    if isinstance(value, bool) or not isinstance(value, Integral if whole else Real):
        return "be a whole number" if whole else "be a number"
    if bounds is not None and not bounds.hold(value):
        return str(bounds)
    return None


def _shown(value: object) -> str:
    text = str(value) if isinstance(value, int | float) else repr(value)
    return text if len(text) <= 80 else f"{text[:60]} ..."


def check_order(low_name: str, low: float, high_name: str, high: float) -> None:
    """Refuse a range that ends where it begins, or before.

    Raises:
        SettingError: If it does.
    """
    if not low < high:
        raise SettingError(f"{low_name} is {low:g}, but must be less than {high_name}, {high:g}.")


def check_range(name: str, ends: tuple[float, float]) -> None:
    """Refuse a pair whose first is greater than its second.

    Raises:
        SettingError: If it is.
    """
    if ends[0] > ends[1]:
        raise SettingError(
            f"{name} is {ends[0]:g} to {ends[1]:g}, but the smaller number must come first."
        )
