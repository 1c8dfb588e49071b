"""Counts what was thrown at the code and what of it did harm; docs/reliability.md is made of it."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FILE_VARIABLE = "SHOOT_TALLY"


@contextmanager
def throw(what: str, outcome: str, times: int = 1) -> Iterator[dict[str, str]]:
    """Throw something at the code; what is checked inside must hold, or it counts as lost.

    Args:
        what: Thrown; rows of the table with one text are added up.
        outcome: What must be seen.
        times: How often it is thrown inside.

    Yields:
        Figures for the table, to be filled: what they are -> text. Of several throws the last
        one's stand there.
    """
    figures: dict[str, str] = {}
    held = False
    try:
        yield figures
        held = True
    finally:
        if name := os.environ.get(FILE_VARIABLE):
            line = {
                "what": what,
                "outcome": outcome,
                "times": times,
                "lost": 0 if held else times,
                "figures": figures,
            }
            # One short write to its end: several test processes may share the file.
            with Path(name).open("ab", buffering=0) as stream:
                stream.write(json.dumps(line).encode() + b"\n")
