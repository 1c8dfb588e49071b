"""What all commands share: parse, run, and say in one sentence what the user can mend."""

import logging
import sys
from collections.abc import Callable
from typing import TypeVar

import tyro
from rich.logging import RichHandler

from lss_core.errors import DataError

Config = TypeVar("Config")


def run(
    config_type: type[Config] | Callable[..., Config],
    function: Callable[[Config], object],
    description: str,
) -> None:
    """Parse the command line into `config_type` and call `function` with it.

    A `DataError` becomes one sentence on standard error and exit status 2; so does a wrong flag.
    """
    logging.basicConfig(
        level=logging.INFO, format="%(message)s", handlers=[RichHandler(show_path=False)]
    )
    try:
        config = tyro.cli(config_type, description=description)
        function(config)
    except DataError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
