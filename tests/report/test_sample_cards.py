"""Cards of a trained run: the samples asked for, with their numbers and their pictures."""

import io
from pathlib import Path

import numpy as np
import pytest
from html_fixture import read_page
from PIL import Image
from world_fixture import NUM_TEMPLATES, TinyRun, command

from shoot.metrics.manoeuvres import classify_manoeuvres
from shoot.metrics.ranks import rank_labels
from shoot.prediction.run import open_run, predict
from shoot.report.sample_cards import make_cards
from shoot.training.planning.data import load_split


def test_cards_hold_what_the_planner_says_of_their_samples(tiny_run: TinyRun) -> None:
    run = open_run(tiny_run.folder)
    split = load_split(run.config.data, "val", run.templates)
    log_prob = predict(run, split)
    cards = make_cards(run, split, log_prob, num=2)
    assert {name: len(group) for name, group in cards.items()} == {
        "best": 2, "typical": 2, "worst": 2,
    }  # fmt: skip
    tokens = [str(token) for token in split.index.sample_token[split.futures.sample]]
    rank = rank_labels(log_prob, split.labels).num_before
    for card in (card for group in cards.values() for card in group):
        position = tokens.index(card.token)
        assert card.probability == pytest.approx(
            np.exp(log_prob[position, split.labels[position]]), rel=1e-5
        )
        assert card.rank == rank[position]
        assert card.num_templates == NUM_TEMPLATES
        assert card.token.startswith(card.scene)  # as the fixture names its samples
        picture = Image.open(io.BytesIO(card.picture))
        assert picture.size == card.size_px
        assert picture.width == 1200
        assert np.asarray(picture.convert("L")).std() > 10.0
    nll = -log_prob[np.arange(len(split.labels)), split.labels]
    moving = classify_manoeuvres(split.futures.xy_m) != "standing"
    assert cards["best"][0].nll == pytest.approx(nll[moving].min())
    assert cards["worst"][0].nll == pytest.approx(nll.max())
    assert cards["best"][0].scene != cards["best"][1].scene


def test_the_command_writes_the_page_beside_the_report(tiny_run: TinyRun, tmp_path: Path) -> None:
    page = tmp_path / "new" / "page.html"
    said = command("shoot-evaluate", tiny_run.folder, "--out", tmp_path / "r.json", "--html", page)
    assert said.status == 0, said.err
    assert f"Page: {page}" in said.out
    text = page.read_text(encoding="utf-8")
    shown = read_page(text).all("dd")
    assert shown[0].text == f"{Path(tiny_run.folder).name}, checkpoint last"
    assert str(tiny_run.root.parent) not in text  # names, not the machine's paths
