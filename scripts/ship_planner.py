"""Makes a finished run ready to be given to others, with a card that says what it is.

    python scripts/ship_planner.py RUN OUT --picture TEMPLATES.png

OUT can be used wherever a run folder can; its data root is relative to itself. RUN's report.json
(shoot-evaluate RUN --out RUN/report.json) gives the card its numbers.
"""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from lss_core.files import write_atomically
from shoot.training.planning.run_folder import PlanningRun

_FILES = (
    "weights.safetensors", "templates.npz", "templates.json", "training_motion.npz",
    "past_motion.safetensors", "environment.json",
)  # fmt: skip
_FILES_OF_LATE = ("scenes.json", "training_cameras.json")  # older runs have none
_METRICS = (
    ("top5", "top-5, %", ".1f"),
    ("top10", "top-10, %", ".1f"),
    ("top20", "top-20, %", ".1f"),
    ("nll", "NLL, nats", ".2f"),
)
_BESIDE = ("prior", "blind", "constant_velocity", "past_motion")


@dataclass(frozen=True)
class ShipConfig:
    """What to give away, and where to.

    Attributes:
        run: Finished run, with report.json.
        out: Folder to write.
        picture: Of its templates, as shoot-fit-templates draws it.
        data_root: Where its data is to be looked for, seen from `out`.
    """

    run: Annotated[Path, tyro.conf.Positional]
    out: Annotated[Path, tyro.conf.Positional]
    picture: Path
    data_root: str = "../../runs/table6/world"  # where table6.py writes it


def ship(config: ShipConfig) -> None:
    """Copy what prediction and baselines need, and write the card."""
    run, out = PlanningRun(config.run), config.out
    out.mkdir(parents=True, exist_ok=True)
    for name in _FILES:
        shutil.copy(run.folder / name, out / name)
    for name in _FILES_OF_LATE:
        if (run.folder / name).exists():
            shutil.copy(run.folder / name, out / name)
    shutil.copy(config.picture, out / "templates.png")
    told = run.config()
    told = replace(
        told,
        data=replace(told.data, root=config.data_root),
        templates="templates.npz",
        out=".",
        resume=False,
    )
    told.save(out / "config.yaml")
    with write_atomically(out / "README.md") as stream:
        stream.write(_card(run, json.loads((run.folder / "report.json").read_text())).encode())


def _card(run: PlanningRun, report: dict[str, Any]) -> str:
    config, templates = run.config(), run.templates()
    world = json.loads((Path(config.data.root) / "world.json").read_text())
    environment = json.loads((run.folder / "environment.json").read_text())
    train_s = json.loads(run.time_file.read_text())["train_s"]
    image, optim = config.data.image, config.optim
    methods, differences = report["methods"], report["differences"]
    table = [_row("this planner", methods["model"])]
    table += [_row(name, methods[name]) for name in _BESIDE]
    table += [_row(f"this planner minus {name}", differences[name], "+") for name in _BESIDE]
    cells = f"{config.model.grid.num_x} x {config.model.grid.num_y}"
    lines = [
        "# A camera planner for the synthetic city",
        "",
        f"Six images of {image.height_px} x {image.width_px} pixels in, a cost map of {cells}",
        f"cells and the probabilities of {len(templates.points)} templates out. It is a run",
        "folder: `shoot-evaluate`, `shoot-render` and `shoot.prediction.run.open_run` take it.",
        "",
        "- **Data**: the training split of the synthetic city of `python scripts/table6.py`:",
        f"  {world['train_scenes']} scenes, seed {world['seed']}; no real images. The table is on",
        f"  its validation split, {world['val_scenes']} scenes in other towns.",
        f"- **Templates**: {templates.card['num_futures']:,} futures of the training scenes, by",
        "  K-Means (`templates.json`, `templates.png`).",
        f"- **Training**: seed {config.seed}, {optim.steps:,} steps of {optim.batch_size} samples,",
        f"  {config.precision}, frustum `{config.model.frustum}`; {train_s / 60.0:.0f} minutes",
        f"  beside other work; torch {environment['libraries']['torch']}. These are the",
        "  weights of the last step: none were chosen by their score.",
        "- **Baselines** are fitted to `training_motion.npz`, labels and past motion of the",
        "  training samples, whatever data it is scored on.",
        "- **Licence**: the project's.",
        "",
        f"| method | {' | '.join(header for _, header, _ in _METRICS)} |",
        "| --- | --- | --- | --- | --- |",
        *table,
        "",
        f"*{report['num_samples']:,} samples of {report['num_scenes']} scenes; 95 % intervals over",
        "scenes, differences paired. Made by `shoot-evaluate` on the validation split.*",
        "",
        "## What for",
        "",
        "To see the whole thing work without training or data; to begin others' training from its",
        "image backbone; to compare with. `shoot-plan --example try` plans with it, `shoot-demo`",
        "shows it in new towns, `shoot-simulate` lets it drive. In Python:",
        "`shoot.prediction.run.open_run`.",
        "",
        "## What not for",
        "",
        "Nothing that may steer a car, and no photographs: it has seen a simple city only, through",
        "one rig and one image size. Nothing speaks for its being of use elsewhere.",
        "",
        "## What it does wrong",
        "",
        "- It sees one moment and no route: at an intersection it does not know the way out",
        "  ([measured](../../docs/results/turns.md)).",
        "- It reads the car's speed from the poses of its cameras, which fire one after the other",
        "  ([measured](../../docs/results/limits.md#speed)); poses of a car that stands make it",
        "  stand.",
        "- Left to drive, it often freezes ([counted](../../docs/results/closed_loop.md)).",
    ]
    return "\n".join(lines) + "\n"


def _row(name: str, metrics: dict[str, dict[str, float]], sign: str = "") -> str:
    cells = (_cell(metrics[metric], sign + form) for metric, _, form in _METRICS)
    return f"| {name.replace('_', ' ')} | {' | '.join(cells)} |"


def _cell(interval: dict[str, float], form: str) -> str:
    value, low, high = (format(interval[key], form) for key in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"


if __name__ == "__main__":
    ship(tyro.cli(ShipConfig, description=__doc__))
