"""How probable the ranked templates are, and where the driven path stands among them."""

from matplotlib.axes import Axes

from shoot.rendering import palette
from shoot.rendering.sample_view import Ranking


def draw_ranks(axes: Axes, ranking: Ranking) -> None:
    """Bars in the colours of the paths; dashed: the template nearest to the driven path."""
    num_best = len(ranking.probabilities)
    places = range(1, num_best + 1)
    percent = 100.0 * ranking.probabilities
    bars = axes.barh(
        list(places),
        percent,
        height=0.72,
        color=[palette.PROBABILITY(float(s)) for s in ranking.strengths],
    )
    for place, bar, value in zip(places, bars, percent, strict=True):
        label = f"{value:.1f} %" if value >= 0.05 else "< 0.1 %"
        if place == ranking.driven_rank:
            bar.set_edgecolor(palette.DRIVEN)
            bar.set_linestyle((0, (2.4, 1.2)))
            bar.set_linewidth(2.0)
        axes.text(
            value + 0.02 * percent[0],
            place,
            label,
            va="center",
            fontsize=10,
            color=palette.DRIVEN if place == ranking.driven_rank else palette.INK,
        )
    axes.set_xlim(0.0, 1.5 * max(float(percent[0]), 1e-3))
    axes.set_ylim(num_best + 0.6, 0.4)
    axes.set_yticks(list(places))
    axes.set_xticks([])
    axes.tick_params(labelsize=10, length=0)
    for side in ("top", "right", "bottom"):
        axes.spines[side].set_visible(False)
    axes.set_title(
        f"The {num_best} most probable of\n{ranking.num_templates:,} templates",
        fontsize=11,
        loc="left",
    )


def describe_driven(ranking: Ranking) -> str | None:
    """One sentence on the template nearest to the driven path."""
    if ranking.driven_rank is None:
        return None
    probability = ranking.driven_probability or 0.0
    distance_m = ranking.driven_distance_m or 0.0
    kind = "Dashed bar" if ranking.driven_rank <= len(ranking.probabilities) else "Not among them"
    return (
        f"{kind}: the template nearest to the driven path (rank\u00a0{ranking.driven_rank}, "
        f"p\u00a0=\u00a0{100.0 * probability:.2g}\u00a0%, {distance_m:.1f}\u00a0m away on average)"
    )
