"""Whether an image file's pixels are what a camera saw, as far as its header tells."""

import struct
from pathlib import Path

from PIL import ExifTags, Image

from lss_core.data.tables.problems import Problem

# Pillow's names for broken chunks.
DAMAGE = (OSError, SyntaxError, ValueError, TypeError, EOFError, LookupError, struct.error)

_REASON = "image of another kind"
_AS_STORED = 1


def content_problem(image: Image.Image, path: Path) -> Problem | None:
    """Why an image is not read though it could be: its pixels would come out other than meant.

    Up to 8 bits a channel are read, in grey, by palette, in colour or CMYK; where there is
    transparency, the colours under it count. Refused are

    - 16 bits a channel: Pillow clips grey to white, and how many of the bits a camera used, 10, 12
      or all, stands nowhere;
    - several frames, of which one would be taken;
    - an EXIF orientation other than upright. Some readers turn such images, others do not, so
      neither the calibration's rows nor the tables' width and height tell which pixels they mean.

    Nothing is decoded.

    Args:
        image: Just opened.
        path: Of its file, to name it.
    """
    flaw = _flaw(image)
    return None if flaw is None else Problem(_REASON, f"The image '{path}' {flaw}.")


def _flaw(image: Image.Image) -> str | None:
    # Pillow names a 16-bit colour's mode as that of 8 bits; only how it will decode tells.
    if image.mode.startswith("I") or ";16" in str(getattr(image, "tile", "")):
        colour = "grey" if image.mode.startswith(("I", "L")) else "colour"
        return f"is 16-bit {colour} (mode {image.mode}); scale it to 8 bits and save it as RGB"
    frames = getattr(image, "n_frames", 1)
    # JPEGs of several pictures begin with the one that counts, previews follow.
    if image.format == "PNG" and frames > 1:
        return f"has {frames} frames; save one image a file"
    orientation = _orientation(image)
    if orientation != _AS_STORED:
        return (
            f"is to be shown turned or mirrored (EXIF orientation {orientation}), and which of its "
            "pixels the calibration means is not known; save it as the calibration means it, "
            "without that tag"
        )
    return None


def _orientation(image: Image.Image) -> int:
    """What EXIF says, 1 to 8; 1 where it says nothing or nothing that can be."""
    # Of a PNG without it, Pillow would decode all to look for it behind the pixels.
    if "exif" not in image.info:
        return _AS_STORED
    try:
        orientation = image.getexif().get(ExifTags.Base.Orientation)
    except DAMAGE:
        return _AS_STORED
    return orientation if isinstance(orientation, int) and 1 <= orientation <= 8 else _AS_STORED
