"""The samples a planner does best, ordinarily and worst at, drawn for the page."""

from typing import Any

import numpy as np
from jaxtyping import Float

from shoot.metrics.manoeuvres import classify_manoeuvres
from shoot.metrics.ranks import negative_log_likelihood, rank_labels
from shoot.prediction.run import TrainedRun
from shoot.rendering import render_sample
from shoot.report.html import SampleCard, figure_png, pick_samples
from shoot.report.sample_views import view_sample
from shoot.training.planning.data import LabelledSplit


def make_cards(
    run: TrainedRun,
    split: LabelledSplit,
    log_prob: Float[np.ndarray[Any, np.dtype[np.floating[Any]]], "S K"],
    num: int = 3,
) -> dict[str, list[SampleCard]]:
    """Cards of the `best`, `typical` and `worst` samples; the best among those that drive.

    Args:
        run: Trained planner.
        split: Samples to choose from.
        log_prob: What it says of them, in nats.
        num: Cards a group.

    Raises:
        DataError: If a file of a chosen sample is missing or damaged.
    """
    nll = negative_log_likelihood(log_prob, split.labels)
    rank = rank_labels(log_prob, split.labels).num_before
    moving = classify_manoeuvres(split.futures.xy_m) != "standing"
    chosen = pick_samples(nll, rank, split.futures.scene, num, moving)

    def card(position: int) -> SampleCard:
        scene = int(split.futures.scene[position])
        return SampleCard(
            picture=figure_png(render_sample(view_sample(run, split, position))),
            token=str(split.index.sample_token[split.futures.sample[position]]),
            scene=str(split.index.scene_name[scene]),
            nll=float(nll[position]),
            rank=int(rank[position]),
            num_templates=len(run.templates.points),
            description=str(split.index.scene_description[scene]),
        )

    return {group: [card(position) for position in places] for group, places in chosen.items()}
