"""Whether files of sensors look whole, without decoding them."""

from pathlib import Path

from lss_core.data.sensors.image_content import content_problem
from lss_core.data.sensors.images import open_image
from lss_core.data.sensors.lidar import check_file
from lss_core.data.sensors.sweep_cuts import SceneSweeps
from lss_core.data.tables.problems import Problem
from lss_core.errors import DataError

_JPEG_END, _PNG_END = b"\xff\xd9", b"IEND"
# Behind its end a camera may have written some more. Within the image's own data no end can stand.
_TAIL_BYTES = 4096


def sweep_problem(path: Path, others: SceneSweeps) -> Problem | None:
    """What is wrong with a lidar sweep's size or layout, beside others of its scene."""
    try:
        check_file(path, others)
    except DataError as error:
        return Problem("damaged lidar sweep", str(error))
    return None


def image_problem(path: Path, image_hw: tuple[int, int]) -> Problem | None:
    """What is wrong with an image file's header, kind, size or end.

    Args:
        path: Of the file.
        image_hw: What the tables say; 0 where they say nothing.
    """
    try:
        with open_image(path) as image:
            width, height = image.size
            is_png = image.format == "PNG"
            problem = content_problem(image, path)
        if problem is not None:
            return problem
        if all(image_hw) and (height, width) != image_hw:
            what = f"The image '{path}' is {width}x{height} px, expected "
            return Problem("image of another size", f"{what}{image_hw[1]}x{image_hw[0]}.")
        with path.open("rb") as stream:
            stream.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            has_end = (_PNG_END if is_png else _JPEG_END) in stream.read()
    except (DataError, OSError) as error:
        return Problem("damaged image", str(error))
    return None if has_end else Problem("damaged image", f"The image '{path}' is cut off.")
