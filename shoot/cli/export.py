"""shoot-export: a trained planner as one file for other runtimes."""

import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from lss_core.bounds import Bounds, check_settings
from lss_core.errors import DataError
from lss_core.files import check_writable
from lss_core.legible import legible
from shoot.cli.app import run
from shoot.cli.asked_run import OtherData
from shoot.export.card import make_card
from shoot.export.companions import write_companions
from shoot.export.graph import PlannerGraph
from shoot.export.int8 import compare_files, quantise
from shoot.export.onnx_file import OPSET, import_onnx, write_onnx
from shoot.export.program import write_program
from shoot.export.samples import read_inputs
from shoot.prediction.run import TrainedRun
from shoot.training.config import task_of
from shoot.training.planning.data import LabelledSplit
from shoot.training.segmentation.config import SegmentConfig


@dataclass(frozen=True)
class ExportConfig:
    """Export a trained planner that sees images.

    Beside each file lie its card (JSON), its templates and `numpy_inputs.py`, which makes its
    inputs of a calibration without torch.

    Attributes:
        run: Run folder.
        onnx: ONNX file to write; needs `pip install 'shoot-planner[export]'`.
        program: File of a `torch.export` program to write.
        int8: Write a second ONNX file, named -int8, whose convolutions run in int8: calibrated on
            as many samples of the run's training split, compared on as many of its validation
            split.
        checkpoint: `last` or `best`.
        data: Data other than the run's own, for int8.
    """

    run: Annotated[str, tyro.conf.Positional]
    onnx: Path | None = None
    program: Path | None = None
    int8: Annotated[int | None, Bounds(1, 10_000)] = None
    checkpoint: Literal["last", "best"] = "last"
    data: OtherData = field(default_factory=OtherData)

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def int8_file(self) -> Path | None:
        """The second ONNX file, if one is asked for."""
        if self.onnx is None or self.int8 is None:
            return None
        return self.onnx.with_name(f"{self.onnx.stem}-int8.onnx")


def export(config: ExportConfig) -> list[Path]:
    """Write what is asked for, and say what was written; returns the exported files.

    Raises:
        DataError: If run or data are not as they should be, or packages are missing.
        OSError: If a file cannot be written.
    """
    # What the exporter says of single nodes is not for users of this command.
    for name in ("onnxscript", "onnx_ir"):
        logging.getLogger(name).setLevel(logging.WARNING)
    files = [file for file in (config.onnx, config.program, config.int8_file) if file]
    _check_asked(config)
    for file in files:
        check_writable(file)
    trained = config.data.open_run(config.run, config.checkpoint)
    trained.module.cpu()
    graph = PlannerGraph(trained.module)
    card = make_card(trained, graph)
    # Before what takes long: the data may not be there.
    splits = _load_splits(trained) if config.int8_file else ()
    beside = {
        companion
        for file in (config.onnx, config.program)
        if file
        for companion in write_companions(trained, card, file)
    }
    print(f"Card, templates and inputs: {', '.join(map(str, sorted(beside)))}")
    if config.onnx:
        write_onnx(graph, config.onnx)
        print(f"ONNX, opset {OPSET}: {config.onnx} ({_size(config.onnx)})")
    if config.program:
        write_program(graph, config.program)
        print(f"Program of torch.export: {config.program} ({_size(config.program)})")
    if config.onnx and config.int8_file and config.int8:
        calibration, held_out = (read_inputs(trained, card, split, config.int8) for split in splits)
        quantise(config.onnx, config.int8_file, calibration)
        found = compare_files(config.onnx, config.int8_file, list(held_out))
        print(f"ONNX in int8: {config.int8_file} ({_size(config.int8_file)})\n{found.sentence}")
    return files


def _check_asked(config: ExportConfig) -> None:
    if not (config.onnx or config.program):
        raise DataError("Nothing is asked for; name a file with --onnx, --program or both.")
    if config.int8 and not config.onnx:
        raise DataError("--int8 goes with an ONNX file; name one with --onnx.")
    if task_of(Path(config.run)) == SegmentConfig.task:
        raise DataError(
            f"'{legible(config.run)}' is a segmentation, and only planners can be exported."
        )
    if config.onnx:
        import_onnx()


def _load_splits(trained: TrainedRun) -> tuple[LabelledSplit, LabelledSplit]:
    told = trained.config
    first, second = (
        trained.task.load_split(told.data, name) for name in (told.train_split, told.val_split)
    )
    return first, second


def _size(file: Path) -> str:
    return f"{file.stat().st_size / 1e6:.1f} MB"


def main() -> None:
    """Entry point of `shoot-export`."""
    run(ExportConfig, export, "Export a trained planner for other runtimes.")
