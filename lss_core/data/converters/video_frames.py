"""Single frames of a video, decoded into files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lss_core.errors import DataError
from lss_core.files import write_atomically

_QUALITY = 95


def import_av() -> Any:
    """PyAV, which brings the decoders.

    Raises:
        DataError: If it is not installed.
    """
    try:
        import av
    except ImportError as error:
        raise DataError(
            "Videos need PyAV, which is not installed: pip install 'shoot-planner[video]'."
        ) from error
    return av


def decode_frames(video: Path, rows: Sequence[int], folder: Path, prefix: str) -> list[Path]:
    """Write frames of a video as JPEGs; those that are there already stay as they are.

    Args:
        video: File of any kind that PyAV reads.
        rows: Which frames, counted from 0, increasing.
        folder: For the files.
        prefix: Their names are this and the frame's number in six digits.

    Returns:
        Files of `rows`, or of the first of them if the video ends before the last.

    Raises:
        DataError: If it is no video.
        OSError: If it is not there, or a file cannot be written.
    """
    av = import_av()
    files = {row: folder / f"{prefix}{row:06d}.jpg" for row in rows}
    if all(file.exists() for file in files.values()):
        return list(files.values())
    written = []
    try:
        with av.open(str(video)) as container:
            # Frames depend on those before: all are decoded, also those that nobody wants.
            for row, frame in enumerate(container.decode(video=0)):
                if row in files:
                    if not files[row].exists():
                        with write_atomically(files[row], one_of_many=True) as stream:
                            frame.to_image().save(stream, "JPEG", quality=_QUALITY)
                    written.append(files[row])
                if len(written) == len(files):
                    break
    except av.error.InvalidDataError as error:
        raise DataError(f"'{video}' is no video that can be decoded: {error.strerror}.") from error
    return written
