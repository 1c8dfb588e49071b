"""Where commands are entered: what they need beyond the core is named where it is not installed."""

import sys
from collections.abc import Callable
from importlib import import_module


def _door(module: str, extra: str) -> Callable[[], None]:
    """Entry point of a command, and the extra of pyproject.toml that brings its libraries."""

    def enter() -> None:
        try:
            import_module(f"shoot.cli.{module}").main()
        except ModuleNotFoundError as error:
            library = (error.name or "").partition(".")[0]
            if library in ("", "lss_core", "shoot"):
                raise
            print(
                f"error: This command needs {library}, which is not installed: "
                f"pip install 'shoot-planner[{extra}]'.",
                file=sys.stderr,
            )
            sys.exit(2)

    return enter


check = _door("check", "train")
convert = _door("convert", "train")
demo = _door("demo", "demo")
evaluate = _door("evaluate", "train")
export = _door("export", "train")
fit_templates = _door("fit_templates", "train")
make_world = _door("make_world", "demo")
plan = _door("plan", "train")
render = _door("render", "train")
simulate = _door("simulate", "demo")
train = _door("train", "train")
view = _door("view", "train")
