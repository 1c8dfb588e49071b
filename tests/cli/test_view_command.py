"""shoot-view: what cannot be shown is said in one sentence."""

from pathlib import Path

from world_fixture import TinyRun, TinySegmenter, command, complaint


def test_a_scene_that_is_not_there(tiny_run: TinyRun, tmp_path: Path) -> None:
    page = tmp_path / "scene.html"
    said = complaint(command("shoot-view", tiny_run.folder, "--scene", "scene-7", "--out", page))
    assert "no scene 'scene-7' in split 'val', which has 3: 'scene-0003', 'scene-0012'" in said
    # One of the training is none of the validation.
    said = command("shoot-view", tiny_run.folder, "--scene", "scene-0001", "--out", page)
    assert "'scene-0001'" in complaint(said)
    assert not page.exists()
    said = command("shoot-view", tiny_run.folder, "--split", "validation", "--out", page)
    assert "'validation'" in complaint(said)


def test_a_segmentation_is_refused(tiny_segmenter: TinySegmenter, tmp_path: Path) -> None:
    said = complaint(command("shoot-view", tiny_segmenter.folder, "--out", tmp_path / "scene.html"))
    assert "is a segmentation" in said
    assert "shoot-render" in said


def test_a_page_that_cannot_be_written(tiny_run: TinyRun, tmp_path: Path) -> None:
    assert str(tmp_path) in complaint(command("shoot-view", tiny_run.folder, "--out", tmp_path))
    (tmp_path / "file").touch()
    below = tmp_path / "file" / "scene.html"
    assert str(tmp_path / "file") in complaint(
        command("shoot-view", tiny_run.folder, "--out", below)
    )


def test_what_is_damaged_is_left_out_where_allowed(spoilt: TinyRun, tmp_path: Path) -> None:
    page = tmp_path / "scene.html"
    image = spoilt.root / "samples" / "CAM_FRONT" / "scene-0003-00.jpg"
    image.unlink()
    assert str(image) in complaint(command("shoot-view", spoilt.folder, "--out", page))
    said = command("shoot-view", spoilt.folder, "--skip-bad", "--out", page)
    assert said.status == 0, said.err
    assert "4 samples of scene-0003" in said.out
