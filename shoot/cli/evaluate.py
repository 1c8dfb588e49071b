"""shoot-evaluate: how good a run is, beside the baselines, with intervals."""

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import tyro

from lss_core.bounds import check_settings
from lss_core.data.usable import LEFT_OUT, LeftOut, save_left_out
from lss_core.files import check_writable
from shoot.cli.app import run
from shoot.cli.asked_run import OtherData, refuse_settings
from shoot.evaluation.comparison import score, sum_up
from shoot.evaluation.results import MODEL, Report
from shoot.evaluation.segmentation.results import SegmentationReport
from shoot.evaluation.segmentation.scoring import score_segmentation
from shoot.prediction.run import TrainedRun
from shoot.report.html import PageDetails, write_page
from shoot.report.sample_cards import make_cards
from shoot.report.segmentation_table import format_segmentation
from shoot.report.terminal import format_table
from shoot.training.allocation import keep_freed_memory
from shoot.training.config import task_of
from shoot.training.segmentation.config import SegmentConfig


@dataclass(frozen=True)
class EvaluateConfig:
    """Score a trained planner or segmentation on a split.

    Attributes:
        run: Run folder.
        out: Report to write, JSON.
        html: Page to write too, of a planner: one file with tables, plots and pictures, for any
            browser.
        split: Scenes to score on.
        checkpoint: `last`, or `best`: chosen on the run's validation split, by top-10 or mean IoU.
        templates: Template file, if not the run's own copy; refused if it holds other templates.
        fast: Predict with what this machine is fastest in, of a planner: compiled, in bfloat16
            where it has units for it, the cost map only where templates lie. The same to rounding.
        allow_seen_scenes: Score also scenes that the run was trained on, or its templates fitted.
        data: Data other than the run's own.
    """

    run: Annotated[str, tyro.conf.Positional]
    out: str = "report.json"
    html: str | None = None
    split: str = "val"
    checkpoint: Literal["last", "best"] = "last"
    templates: str | None = None
    fast: bool = False
    allow_seen_scenes: bool = False
    data: OtherData = field(default_factory=OtherData)

    def __post_init__(self) -> None:
        check_settings(self)


def evaluate(config: EvaluateConfig) -> Report | SegmentationReport:
    """Score, print the table and save the report.

    Raises:
        DataError: If run or data are not as they should be, or the run has seen the scenes.
        OSError: If a file cannot be written.
    """
    for path in filter(None, (config.out, config.html)):
        check_writable(path)
    if task_of(Path(config.run)) == SegmentConfig.task:
        return _evaluate_segmentation(config)
    return _evaluate_planner(config)


def _evaluate_segmentation(config: EvaluateConfig) -> SegmentationReport:
    of_planners = {"--html": config.html, "--templates": config.templates, "--fast": config.fast}
    refuse_settings(of_planners, config.run)
    trained = config.data.open_segmenter(config.run, config.checkpoint)
    keep_freed_memory()
    samples = trained.task.load_split(trained.config.data, config.split)
    report = score_segmentation(trained, samples, config.split, config.allow_seen_scenes)
    print(format_segmentation(report))
    _save(report, config, samples.left_out)
    return report


def _evaluate_planner(config: EvaluateConfig) -> Report:
    trained = config.data.open_run(config.run, config.checkpoint, config.templates)
    keep_freed_memory()
    scored = score(trained, config.split, config.fast, config.allow_seen_scenes)
    report = sum_up(trained, scored, config.split)
    print(format_table(report))
    _save(report, config, scored.samples.left_out)
    if config.html is not None:
        cards = make_cards(trained, scored.samples, scored.log_probs[MODEL])
        write_page(report, cards, _details(config, trained), config.html)
        print(f"Page: {config.html}")
    return report


def _save(
    report: Report | SegmentationReport, config: EvaluateConfig, left_out: tuple[LeftOut, ...]
) -> None:
    """The report, and what was left out of it."""
    report.save(Path(config.out))
    print(f"Report: {config.out}")
    listed = Path(config.out).with_suffix(f".{LEFT_OUT}")
    save_left_out(listed, {config.split: left_out})
    if left_out:
        print(f"Left out: {len(left_out)} samples, listed in {listed}")


def _details(config: EvaluateConfig, trained: TrainedRun) -> PageDetails:
    data = trained.config.data
    return PageDetails(
        run=Path(config.run).resolve().name,
        data_set=f"{Path(data.root).resolve().name}, {data.version}",
        date=f"{datetime.now():%Y-%m-%d %H:%M}",
        checkpoint=config.checkpoint,
        num_templates=len(trained.templates.points),
        horizon_s=trained.templates.horizon_s,
    )


def main() -> None:
    """Entry point."""
    run(EvaluateConfig, evaluate, "Score a trained planner or segmentation beside its baselines.")
