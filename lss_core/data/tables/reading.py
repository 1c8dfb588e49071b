"""The nuScenes tables: typed records of the columns that are used, a piece of a file at a time.

Two of the tables have millions of records. Only the records of one piece stand in memory; columns
that no record names are passed over by the parser.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from lss_core.errors import DataError

# Small enough for the cache of a processor: three times as fast as pieces of 16 MB.
_PIECE_BYTES = 1 << 18

# Arrays of texts are as wide as the longest. Real tokens have 32 or 64 letters.
Short = Annotated[str, msgspec.Meta(max_length=256)]
FileName = Annotated[str, msgspec.Meta(max_length=1024)]


class Record(msgspec.Struct, gc=False):
    """What every record has. Times are in microseconds, lengths in metres, as in the files."""

    token: Short


class Scene(Record, gc=False):
    """A drive of some seconds."""

    name: Short
    description: str
    log_token: Short


class Log(Record, gc=False):
    """Where a drive was."""

    location: Short


class Sample(Record, gc=False):
    """A keyframe of a scene."""

    scene_token: Short
    timestamp: float


class SampleData(Record, gc=False):
    """A file of one sensor, at a keyframe or between two."""

    sample_token: Short
    ego_pose_token: Short
    calibrated_sensor_token: Short
    timestamp: float
    is_key_frame: bool | int | None
    filename: FileName
    width: float | None = None
    height: float | None = None


class EgoPose(Record, gc=False):
    """The ego frame in `global`; the quaternion is w, x, y, z."""

    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class CalibratedSensor(Record, gc=False):
    """A sensor's frame in `ego`; the intrinsics are 3 x 3 for cameras.

    Distortion is not known to the format, but people add it.
    """

    sensor_token: Short
    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]
    camera_intrinsic: list[list[float]] | None = None
    camera_distortion: Any = None


class Sensor(Record, gc=False):
    """A place on the car."""

    channel: Short


class Annotation(Record, gc=False):
    """An object's box at a keyframe, in `global`; size is width, length, height."""

    sample_token: Short
    instance_token: Short
    translation: tuple[float, float, float]
    size: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


class Instance(Record, gc=False):
    """An object, seen in one scene."""

    category_token: Short


class Category(Record, gc=False):
    """A kind of object, as `vehicle.car`."""

    name: Short


# Without these there is no index.
TABLES: dict[type[Record], str] = {
    CalibratedSensor: "calibrated_sensor",
    EgoPose: "ego_pose",
    Log: "log",
    Sample: "sample",
    SampleData: "sample_data",
    Scene: "scene",
    Sensor: "sensor",
}

# Read for labels and evaluation only; a data set may lack them.
ANNOTATION_TABLES: dict[type[Record], str] = {
    Annotation: "sample_annotation",
    Category: "category",
    Instance: "instance",
}

RecordT = TypeVar("RecordT", bound=Record)


def table_path(folder: Path, record_type: type[Record]) -> Path:
    """Where a version's folder has the table of a type of record."""
    return folder / f"{(TABLES | ANNOTATION_TABLES)[record_type]}.json"


def read_table(folder: Path, record_type: type[RecordT]) -> list[RecordT]:
    """All records of a table, for those that are not long.

    Raises:
        DataError: If the table cannot be read, is no JSON or has a record of another kind.
    """
    return [record for piece in read_pieces(folder, record_type) for record in piece]


def read_pieces(folder: Path, record_type: type[RecordT]) -> Iterator[list[RecordT]]:
    """The records of a table, in order, some hundred at a time.

    Raises:
        DataError: If the table cannot be read, is no JSON or has a record of another kind.
    """
    path = table_path(folder, record_type)
    records_type: type[list[RecordT]] = list[record_type]  # type: ignore[valid-type]
    decode = msgspec.json.Decoder(records_type).decode
    done = 0
    try:
        with path.open("rb") as stream:
            rest = stream.read(_PIECE_BYTES)
            while block := stream.read(_PIECE_BYTES):
                rest += block
                end = rest.rfind(b"},") + 1
                try:
                    records = decode(rest[:end] + b"]")
                except msgspec.ValidationError:
                    raise
                except msgspec.DecodeError:
                    # Damaged, written in another way, or `},` stood in a text. A cut at a wrong
                    # place never leaves whole records, so none goes unnoticed.
                    break
                yield records
                done += len(records)
                rest = b"[" + rest[end + 1 :]
            rest += stream.read()
        yield decode_json(rest, records_type)
    except msgspec.ValidationError as error:
        # msgspec counts records from the start of the piece.
        text = re.sub(r"\$\[(\d+)\]", lambda found: f"$[{int(found[1]) + done}]", str(error))
        raise DataError(f"The table '{path}' is not as it should be: {text}.") from error
    except (ValueError, OverflowError, RecursionError) as error:
        raise DataError(
            f"The table '{path}' is damaged after {done} or more records ({error}); unpack it anew."
        ) from error
    except OSError as error:
        raise DataError(f"The table '{path}' cannot be read: {error}.") from error


def decode_json(text: bytes, kind: Any) -> Any:
    """JSON as values of a type, also where it has NaN, which msgspec does not know.

    Args:
        text: JSON.
        kind: What msgspec may make of it, as a struct or a list of them.

    Raises:
        ValueError: If it is no JSON (`msgspec.ValidationError`: JSON of something else).
    """
    try:
        return msgspec.json.decode(text, type=kind)
    except msgspec.ValidationError:
        raise
    except msgspec.DecodeError:
        # Python's own parser is slow, but knows NaN, which Python also writes.
        letters = text.decode(json.detect_encoding(text))
        loaded = json.loads(letters)
        # It also makes texts that nothing can write: of halves of surrogate pairs.
        if "\\ud" in letters.lower():
            json.dumps(loaded, ensure_ascii=False).encode()
        return msgspec.convert(loaded, kind)
