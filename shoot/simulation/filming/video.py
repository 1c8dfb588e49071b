"""Frames as they come, written to an MP4 file."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

from lss_core.errors import DataError
from lss_core.files import write_atomically
from shoot.simulation.filming.canvas import Rgb

# Constant quality of x264: lower is better and larger.
_QUALITY = 25


def import_av() -> Any:
    """PyAV, which brings the encoder.

    Raises:
        DataError: If it is not installed, or has no H.264 encoder.
    """
    try:
        import av
    except ImportError as error:
        raise DataError(
            "Videos need PyAV, which is not installed: pip install 'shoot-planner[video]'."
        ) from error
    if "libx264" not in av.codecs_available:
        raise DataError("Videos need libx264, which the PyAV installed here comes without.")
    return av


def write_video(frames: Iterable[Rgb], path: str | Path, rate_hz: int = 10) -> Path:
    """Write an MP4 file, whole or not at all; no more than a few frames are in memory.

    The same frames give the same bytes with the same libraries.

    Args:
        frames: [H, W, 3] each, of one size, sides even.
        path: Of the file.
        rate_hz: Frames a second.

    Raises:
        DataError: If PyAV is not there.
        ValueError: If there are no frames.
    """
    av = import_av()
    path = Path(path)
    with write_atomically(path) as file, av.open(file, "w", format="mp4") as container:
        stream = None
        for rgb in frames:
            if stream is None:
                # One thread: with more, bytes depend on how many there are.
                options = {"crf": str(_QUALITY), "preset": "fast", "threads": "1"}
                stream = container.add_stream("libx264", rate=Fraction(rate_hz), options=options)
                stream.height, stream.width = rgb.shape[:2]
                stream.pix_fmt = "yuv420p"
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            container.mux(stream.encode(frame))
        if stream is None:
            raise ValueError("A video needs a frame.")
        container.mux(stream.encode(None))
    return path
