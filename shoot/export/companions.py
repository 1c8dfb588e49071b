"""What lies beside an exported planner: its card, its templates, the file that makes its inputs."""

from pathlib import Path
from typing import Any

from lss_core.files import write_atomically
from shoot.export import numpy_inputs
from shoot.export.card import write_card
from shoot.prediction.run import TrainedRun


def write_companions(run: TrainedRun, card: dict[str, Any], path: Path) -> list[Path]:
    """Write them beside `path`; returns theirs.

    Args:
        run: What is exported.
        card: Of it.
        path: Of the exported planner; card and templates are named after it.

    Raises:
        OSError: If one cannot be written.
    """
    card_path = path.with_suffix(".json")
    templates_path = path.with_name(f"{path.stem}-templates.npz")
    helper = Path(numpy_inputs.__file__)
    write_card(card, card_path)
    for source, target in (
        (run.folder.templates_file, templates_path),
        (helper, path.with_name(helper.name)),
    ):
        with write_atomically(target) as stream:
            stream.write(source.read_bytes())
    return [card_path, templates_path, path.with_name(helper.name)]
