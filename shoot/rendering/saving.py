"""A figure becomes a file, whole or not at all."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lss_core.errors import DataError
from lss_core.files import write_atomically


def save_figure(figure: Figure, path: str | Path, dpi: float = 150.0) -> Path:
    """Write a figure in the format its name ends in (png, pdf, svg, jpg) and return the path.

    An older picture of that name stays untouched until the new one is complete.

    Raises:
        DataError: If the format is unknown.
        OSError: If the file cannot be written.
    """
    path = Path(path)
    kind = picture_kind(path)
    with write_atomically(path) as stream:
        figure.savefig(stream, format=kind, dpi=dpi)
    return path


def picture_kind(path: Path) -> str:
    """The format that the name ends in, as `png`.

    Raises:
        DataError: If pictures cannot be written in it.
    """
    kind = path.suffix.lower().removeprefix(".")
    known = FigureCanvasAgg.get_supported_filetypes()
    if kind not in known:
        raise DataError(
            f"Cannot save a picture as {path}: its name must end in one of "
            f"{', '.join(sorted(known))}."
        )
    return kind
