"""Videos: whole or not at all, the same bytes for the same frames."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from film_case import NUM_STEPS, make_film

from lss_core.errors import DataError
from shoot.simulation.filming.frames import HEIGHT_PX, WIDTH_PX, draw_frames
from shoot.simulation.filming.video import write_video

av = pytest.importorskip("av")


def test_a_video_opens_again_with_all_its_frames(tmp_path: Path) -> None:
    frames = list(draw_frames(make_film()))
    first = write_video(iter(frames), tmp_path / "first.mp4")
    again = write_video(iter(frames), tmp_path / "again.mp4")
    assert first.read_bytes() == again.read_bytes()
    assert first.stat().st_size < 1_000_000
    with av.open(str(first)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == (WIDTH_PX, HEIGHT_PX)
        assert stream.average_rate == 10
        assert stream.codec_context.name == "h264"
        shown = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(stream)]
    assert len(shown) == len(frames) == NUM_STEPS
    # What is shown is what was drawn, but for compression.
    assert np.abs(shown[-1] - frames[-1]).mean() < 5.0
    assert np.abs(shown[0] - shown[-1]).mean() > 2.0


def test_a_drawing_that_fails_leaves_no_video(tmp_path: Path) -> None:
    def broken() -> Iterator[np.ndarray]:
        yield np.zeros((64, 64, 3), np.uint8)
        raise MemoryError

    with pytest.raises(MemoryError):
        write_video(broken(), tmp_path / "video.mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_video_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="needs a frame"):
        write_video(iter(()), tmp_path / "video.mp4")
    assert list(tmp_path.iterdir()) == []


def test_without_an_encoder_one_sentence_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(DataError, match=r"pip install 'shoot-planner\[video\]'"):
        write_video(iter(()), tmp_path / "video.mp4")
