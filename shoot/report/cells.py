"""Cells and tables for a terminal: numbers with the interval they have beneath."""

import io
import math
from collections.abc import Iterable

from rich.box import SIMPLE_HEAD
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from shoot.metrics.bootstrap import Interval


def new_table(title: str) -> Table:
    """An empty table."""
    return Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))


def interval_cell(interval: Interval, form: str) -> Text:
    """A mean, its interval (if it has one) beneath; as Text, since rich reads [ ] in str."""
    value = number(interval.value, form)
    if math.isnan(interval.low):
        return Text(value)
    return Text(f"{value}\n[{form.format(interval.low)}, {form.format(interval.high)}]")


def number(value: float, form: str) -> str:
    """A number, or a dash for what does not exist."""
    return "-" if math.isnan(value) else form.format(value)


def spaced(name: str) -> str:
    """A name that can be broken into lines."""
    return name.replace("_", " ")


def as_text(parts: Iterable[RenderableType], width: int) -> str:
    """All below each other, as plain text without blanks at the ends of lines."""
    console = Console(file=io.StringIO(), width=width, color_system=None)
    with console.capture() as captured:
        for part in parts:
            console.print(part)
    return "\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n")
