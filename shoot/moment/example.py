"""A rig file and the images of one moment, to try the command on: drawn, not photographed."""

import shutil
from pathlib import Path

from lss_core.files import write_atomically
from shoot.moment.rig_file import read_rig
from shoot.prediction.shipped import shipped_folder

RIG_FILE = "rig.yaml"
SPEED_MPS = 5.2  # of the car in the moment that scripts/ship_example.py draws


def write_example(folder: Path) -> dict[str, Path]:
    """Write `rig.yaml` and an image of each of its cameras.

    Args:
        folder: For all of it; made if needed.

    Returns:
        Name of a camera -> its image.

    Raises:
        OSError: If a file cannot be written.
    """
    shipped = shipped_folder("example-rig", RIG_FILE)
    images = {camera.name: f"{camera.name}.jpg" for camera in read_rig(shipped / RIG_FILE).cameras}
    for name in (RIG_FILE, *images.values()):
        with (shipped / name).open("rb") as given, write_atomically(folder / name) as stream:
            shutil.copyfileobj(given, stream)
    return {camera: folder / name for camera, name in images.items()}
