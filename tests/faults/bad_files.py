"""Images and sweeps that are damaged, of another kind or not there."""

import io
import os
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bad_data import CAMS, TOKEN, Case, change_frame, image, sweep
from PIL import ExifTags, Image

HW = (36, 64)


def write(
    find: Callable[[Path], Path], contents: Callable[[bytes], bytes]
) -> Callable[[Path], Any]:
    """Give a file other contents, made of the old ones."""
    return lambda root: find(root).write_bytes(contents(find(root).read_bytes()))


def replace_by(find: Callable[[Path], Path], make: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Put something else in a file's place."""

    def spoil(root: Path) -> None:
        find(root).unlink()
        make(find(root))

    return spoil


def picture(kind: str, mode: str = "RGB", hw: tuple[int, int] = HW) -> Callable[[bytes], bytes]:
    """An image file of another kind, with noise in it."""

    def encode(_: bytes) -> bytes:
        noise = np.random.default_rng(0).integers(0, 256, (*hw, 3), dtype=np.uint8)
        whole = Image.fromarray(noise).convert(mode)
        stream = io.BytesIO()
        whole.save(stream, kind)
        return stream.getvalue()

    return encode


def deep_png() -> bytes:
    """Grey of 16 bits."""
    stream = io.BytesIO()
    Image.fromarray(np.full(HW, 4000, dtype=np.uint16)).save(stream, "PNG")
    return stream.getvalue()


def turned_jpeg() -> bytes:
    """To be shown the other way up."""
    stream, exif = io.BytesIO(), Image.Exif()
    exif[ExifTags.Base.Orientation] = 3
    Image.new("RGB", HW[::-1], (90, 90, 90)).save(stream, "JPEG", exif=exif)
    return stream.getvalue()


def png_of(width: int, height: int) -> bytes:
    """The start of a PNG that claims a size."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(b"\0" * 100))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body + chunk(b"IEND", b"")


def flipped(old: bytes, place: float = 0.6) -> bytes:
    at = int(place * len(old))
    return old[:at] + bytes([old[at] ^ 255]) + old[at + 1 :]


def points(change: Callable[[np.ndarray], Any]) -> Callable[[bytes], bytes]:
    """Another sweep, made of the old one's points."""

    def rewritten(old: bytes) -> bytes:
        values = np.frombuffer(old, np.float32).reshape(-1, 5).copy()
        change(values)
        return values.tobytes()

    return rewritten


def fill(where: Any, value: float) -> Callable[[np.ndarray], Any]:
    def change(values: np.ndarray) -> None:
        values[where] = value

    return change


NAME = "scene-0001-01.jpg"
DAMAGED, MISSING = "damaged image", "missing image"
png = picture("PNG")

_IMAGE_BYTES: dict[str, tuple[Callable[[bytes], bytes], str | None]] = {
    # Contents; why it is left out, if it is.
    "zero bytes": (lambda _: b"", DAMAGED),
    "one byte": (lambda _: b"\xff", DAMAGED),
    "first two bytes": (lambda old: old[:2], DAMAGED),
    "header only": (lambda old: old[:200], DAMAGED),
    "half of it": (lambda old: old[: len(old) // 2], DAMAGED),
    "all but 40 bytes": (lambda old: old[:-40], DAMAGED),
    "without its first half": (lambda old: old[len(old) // 2 :], DAMAGED),
    "text": (lambda _: b"no image at all", DAMAGED),
    "an HTML page": (lambda _: b"<!DOCTYPE html><title>404</title>", DAMAGED),
    "a Git LFS pointer": (lambda _: b"version https://git-lfs.github.com/spec/v1\n", DAMAGED),
    "zeros": (lambda old: bytes(len(old)), DAMAGED),
    "noise": (lambda old: np.random.default_rng(1).bytes(len(old)), DAMAGED),
    "GIF": (picture("GIF"), DAMAGED),
    "TIFF": (picture("TIFF"), DAMAGED),
    "BMP": (picture("BMP"), DAMAGED),
    "EPS, which is a program": (picture("EPS"), DAMAGED),
    "PDF": (picture("PDF"), DAMAGED),
    "PNG cut off": (lambda old: png(old)[:-60], DAMAGED),
    "PNG of a giant": (lambda _: png_of(100_000, 100_000), DAMAGED),
    "PNG of no size": (lambda _: png_of(0, 0), DAMAGED),
    "twice as large": (picture("JPEG", hw=(72, 128)), "image of another size"),
    "lying": (picture("JPEG", hw=(64, 36)), "image of another size"),
    "one pixel": (picture("JPEG", hw=(1, 1)), "image of another size"),
    "one column less": (picture("JPEG", hw=(36, 63)), "image of another size"),
    "grey": (picture("JPEG", "L"), None),
    "CMYK": (picture("JPEG", "CMYK"), None),
    "PNG": (png, None),
    "PNG with a palette": (picture("PNG", "P"), None),
    "PNG with alpha": (picture("PNG", "RGBA"), None),
    "PNG of one bit": (picture("PNG", "1"), None),
    "PNG of 16 bits": (lambda _: deep_png(), "image of another kind"),
    "turned by EXIF": (lambda _: turned_jpeg(), "image of another kind"),
    "with text behind its end": (lambda old: old + b"camera 4711" * 20, None),
}


def _directory(path: Path) -> None:
    path.mkdir()


_OTHER_THINGS: dict[str, Callable[[Path], Any]] = {
    "nothing": lambda path: None,
    "a folder": _directory,
    "a pipe": os.mkfifo,
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a link to itself": lambda path: path.symlink_to(path.name),
}

IMAGES = [
    *(
        Case("images", name, write(image, contents), reason and (NAME,), reason and 1, reason or "")
        for name, (contents, reason) in _IMAGE_BYTES.items()
    ),
    # Looks whole; the damage is found when it is decoded.
    Case(
        "images",
        "PNG with a wrong checksum",
        write(image, lambda old: flipped(png(old))),
        (NAME, TOKEN),
    ),
    *(
        Case("images", f"{name} in its place", replace_by(image, make), (NAME, TOKEN), 1, MISSING)
        for name, make in _OTHER_THINGS.items()
    ),
    *(
        Case(
            "images",
            f"size {width} x {height} in the table",
            change_frame("sample_data", CAMS[0], width=width, height=height),
            says,
            says and 1,
            "impossible image size" if says else "",
        )
        for width, height, says in (
            (None, None, None),
            (..., ..., None),
            (0, 0, None),
            (64.0, 36.0, None),
            (-64, 36, ("width -64",)),
            (64, 1e30, ("height 1e+30",)),
            (63.5, 36, ("width 63.5",)),
            (float("nan"), 36, ("width nan",)),
            (float("inf"), 36, ("width inf",)),
        )
    ),
    Case(
        "images",
        "size 80 x 45 in the table",
        change_frame("sample_data", CAMS[0], width=80, height=45),
        (NAME, "80x45"),
        1,
        "image of another size",
    ),
    Case(
        "images",
        "size 1600 x 900 in the table",
        change_frame("sample_data", CAMS[0], width=1600, height=900),
        ("calibrated_sensor.json", "principal point", "images 0.04 times as large"),
        1,
        "calibration against image",
    ),
    Case(
        "images",
        "size 10**400 in the table",
        change_frame("sample_data", CAMS[0], width=10**400),
        ("sample_data.json",),
    ),
]

SWEEP_NAME = "scene-0001-005.pcd.bin"
_sweep = partial(Case, "sweeps", lidar=1)
BAD_SWEEP = "damaged lidar sweep"

SWEEPS = [
    *(
        _sweep(
            f"{name} in its place", replace_by(sweep, make), (SWEEP_NAME,), 1, "missing lidar sweep"
        )
        for name, make in _OTHER_THINGS.items()
    ),
    _sweep("zero bytes", write(sweep, lambda _: b""), (SWEEP_NAME, TOKEN), 1, BAD_SWEEP),
    *(
        _sweep(
            f"{cut} bytes less",
            write(sweep, lambda old, cut=cut: old[:-cut]),
            (SWEEP_NAME, "within a point"),
            1,
            BAD_SWEEP,
        )
        for cut in (1, 4, 16, 19, 21)
    ),
    _sweep("three bytes more", write(sweep, lambda old: old + b"abc"), (SWEEP_NAME,), 1, BAD_SWEEP),
    _sweep(
        "four numbers a point",
        write(sweep, lambda old: np.ones((11, 4), np.float32).tobytes()),
        (SWEEP_NAME,),
        1,
        BAD_SWEEP,
    ),
    _sweep("text", write(sweep, lambda _: b"no sweep"), (SWEEP_NAME,), 1, BAD_SWEEP),
    # Points without a place are left out, as sensors mean it.
    *(
        _sweep(f"{name} {value}", write(sweep, points(fill(where, value))), None)
        for name, where in (
            ("one x", (0, 0)),
            ("three points", slice(3)),
            ("intensities", (slice(4), 3)),
        )
        for value in (np.nan, np.inf, -np.inf, 3e38)
    ),
    _sweep("rings that are none", write(sweep, points(fill((slice(None), 4), np.nan))), None),
    _sweep("one point", write(sweep, lambda old: old[:20]), None),
    *(
        _sweep(
            f"all points {value}",
            write(sweep, points(fill(slice(None), value))),
            (SWEEP_NAME, TOKEN, "none of its points"),
        )
        for value in (np.nan, np.inf, -1e30)
    ),
]
