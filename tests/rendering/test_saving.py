from pathlib import Path

import pytest
from matplotlib.figure import Figure

from lss_core.errors import DataError
from shoot.rendering import save_figure


class BrokenFigure(Figure):
    def savefig(self, fname, **kwargs) -> None:  # type: ignore[no-untyped-def, override]
        fname.write(b"half a picture")
        raise RuntimeError("the power went out")


def test_failed_save_leaves_the_old_picture_and_no_rest(tmp_path: Path) -> None:
    path = tmp_path / "new" / "picture.png"
    save_figure(Figure(figsize=(1, 1)), path)
    before = path.read_bytes()
    assert before.startswith(b"\x89PNG")
    with pytest.raises(RuntimeError, match="power"):
        save_figure(BrokenFigure(), path)
    assert path.read_bytes() == before
    with pytest.raises(RuntimeError, match="power"):
        save_figure(BrokenFigure(), path.with_name("other.png"))
    assert [p.name for p in path.parent.iterdir()] == ["picture.png"]


def test_saving_by_name_and_where_it_cannot(tmp_path: Path) -> None:
    assert save_figure(Figure(), tmp_path / "a.PDF").read_bytes().startswith(b"%PDF")
    with pytest.raises(DataError, match="must end in one of"):
        save_figure(Figure(), tmp_path / "a.npz")
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(FileExistsError, match="/file'"):
        save_figure(Figure(), tmp_path / "file" / "a.png")
