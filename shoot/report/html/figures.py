"""Plots as parts of the page, with captions and a list of what each mark means."""

from collections.abc import Iterable, Mapping

import numpy as np

from shoot.evaluation.results import MODEL, Results
from shoot.metrics.bootstrap import Interval
from shoot.report.html.columns import NLL, TOP_10
from shoot.report.html.markup import Html, element, join, note
from shoot.report.html.plots import (
    Look,
    draw_key,
    draw_parts,
    draw_reliability,
    draw_top_k,
    method_looks,
    reliability_limit,
)
from shoot.report.html.svg import inline_svg
from shoot.report.html.words import spaced

# More than these cannot be told apart in one plot.
MOST_PLOTTED = 6


def plotted_methods(methods: Mapping[str, Mapping[str, Interval]]) -> list[str]:
    """The methods in the plots: model, prior, and the best of the others by NLL, in their order."""
    first = [name for name in (MODEL, "prior") if name in methods]
    nll = {
        name: metrics["nll"].value if "nll" in metrics else np.inf
        for name, metrics in methods.items()
        if name not in first
    }
    others = sorted(nll, key=lambda name: np.nan_to_num(nll[name], nan=np.inf))
    chosen = {*first, *others[: MOST_PLOTTED - len(first)]}
    return [name for name in methods if name in chosen]


def top_k_figures(methods: Mapping[str, Mapping[str, Interval]]) -> Html:
    """Top-k accuracy against k."""
    names = plotted_methods(methods)
    looks = method_looks(names)
    plot = inline_svg(
        draw_top_k(methods, looks),
        "topk",
        f"Top-k accuracy against k of {_listed(names)}; the numbers are in the table above.",
    )
    return join(
        _key("topk", looks),
        element("div", element("figure", plot), class_="figures"),
        _left_out(methods, names),
    )


def part_figures(anchor: str, title: str, parts: Mapping[str, Results], overall: Results) -> Html:
    """Top-10 and NLL of each part side by side.

    Args:
        anchor: Unlike that of other groups of parts; letters only.
        title: What the parts are of.
        parts: Part -> results.
        overall: Of all samples, which decides on the methods shown.
    """
    names = plotted_methods(overall.methods)
    looks = method_looks(names)
    plots = (
        element(
            "figure",
            inline_svg(
                draw_parts(parts, column, looks),
                f"{anchor}{column.key}",
                f"{title}: {column.name} of {_listed(names)} in {_listed(parts)}, with intervals; "
                "the numbers are in the table above.",
            ),
        )
        for column in (TOP_10, NLL)
    )
    return join(_key(anchor, looks), element("div", *plots, class_="figures"))


def reliability_figures(overall: Results) -> Html:
    """A reliability diagram for each method plotted that is not equally sure of all samples."""
    every = overall.reliability
    names = plotted_methods(overall.methods)
    shown = {name: every[name] for name in names if name in every and len(every[name].accuracy) > 1}
    if not shown:
        return Html()
    looks = method_looks(names)
    limit = reliability_limit(shown)
    diagrams = [
        element(
            "figure",
            inline_svg(
                draw_reliability(bins, looks[name], limit),
                f"reliability{idx}",
                f"Reliability of {spaced(name)}. Most probable template: given "
                + ", ".join(
                    f"{100.0 * said:.1f} % it is the label in {100.0 * found:.1f} %"
                    for said, found in zip(bins.confidence, bins.accuracy, strict=True)
                )
                + ".",
            ),
            element("figcaption", spaced(name)),
        )
        for idx, (name, bins) in enumerate(shown.items())
    ]
    return join(
        note(
            "Each point holds about the same number of samples. On the dashed line the most "
            "probable template is the label as often as its probability says; below it the method "
            "is too sure, above it not sure enough. Methods that are equally sure of all samples "
            "would be one point and are left out."
        ),
        element("div", *diagrams, class_="figures"),
    )


def _key(anchor: str, looks: Mapping[str, Look]) -> Html:
    return element(
        "ul",
        *(
            element(
                "li",
                inline_svg(draw_key(look), f"{anchor}key{idx}", f"Mark of {spaced(name)}"),
                spaced(name),
            )
            for idx, (name, look) in enumerate(looks.items())
        ),
        class_="key",
    )


def _left_out(methods: Mapping[str, object], names: Iterable[str]) -> Html:
    rest = [name for name in methods if name not in set(names)]
    if not rest:
        return Html()
    return note(
        f"In the plots of this page {MOST_PLOTTED} methods at most are shown; in the tables only: "
        f"{_listed(rest)}."
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(spaced(name) for name in names)
