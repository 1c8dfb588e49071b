"""Planners on vocabularies: their template files, and what the queue does with each run."""

from pathlib import Path

from planning_table.records import record_of
from planning_table.work import PLANNERS
from run_queue import Experiment, Kind, Place, Record

from shoot.cli.fit_templates import DataSource, FitTemplatesConfig, fit
from shoot.world.config import VERSION
from vocabulary_table.vocabularies import Vocabulary


def make_file(vocabulary: Vocabulary, place: Place) -> None:
    """Its template file, unless it is there."""
    out = vocabulary.file(place)
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        data = DataSource(str(place.world), VERSION)
        fit(FitTemplatesConfig(data, str(out), k=vocabulary.k, method=vocabulary.method))


def _record_of(experiment: Experiment, folder: Path, jobs: int) -> Record:
    """As of any planner; its only flag names a file, of which the fingerprint is enough."""
    method, k = experiment.planner.split("-")
    record = record_of(experiment, folder, jobs)
    return record | {"flags": [], "method": method, "k": int(k)}


# The template file is among the flags of each experiment.
ON_VOCABULARIES = Kind(
    train_flags=lambda place: (),
    evaluate_flags=PLANNERS.evaluate_flags,
    record_of=_record_of,
    told=PLANNERS.told,
)
