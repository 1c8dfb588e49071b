"""What the words of the page mean and what its numbers do not tell, folded away."""

from collections.abc import Iterable
from typing import Final

from shoot.metrics.bootstrap import NUM_DRAWS, Groups, name_groups
from shoot.report.html.markup import Html, element, folded, join, note
from shoot.report.html.words import spaced
from shoot.trajectories import HORIZON_S

# Methods with other names are listed without a word.
METHOD_NOTES: Final = {
    "model": "the trained planner: camera images and poses in; it is told no speed, command or map",
    "prior": "how often each template was driven in training; sees nothing",
    "speed_prior": "the same at about the speed of now; knows the speed, sees nothing",
    "standing_still": "stays where it is; sees nothing",
    "constant_velocity": "drives straight on at the speed of now; sees nothing else",
    "constant_velocity_with_prior": "the same, times how often each template was driven",
    "constant_yaw_rate": "drives on at the speed and in the bend of now; sees nothing else",
    "constant_yaw_rate_with_prior": "the same, times how often each template was driven",
    "past_motion": "fitted to how the ego moved until now; sees nothing else",
    "blind": "one cost map for all samples, the best there is without looking",
    "model_knowing_speed": "the trained planner, told the speed afterwards; no baseline, it shows "
    "what the speed would add",
}


def reading_guide(
    num_templates: int | None,
    resampled: Groups,
    num_groups: int,
    methods: Iterable[str],
    horizon_s: float = HORIZON_S,
) -> Html:
    """The page's idea in a line; to be opened: its words, its limits and its methods.

    Args:
        num_templates: K, if known.
        resampled: What intervals are over.
        num_groups: How many of them there are.
        methods: Keys of all methods.
        horizon_s: How far ahead the templates go.
    """
    one_of = (
        "fixed trajectories" if num_templates is None else f"{num_templates} fixed trajectories"
    )
    one = resampled.removesuffix("s")
    points = [
        _point(
            "Template",
            f"one of {one_of} of the next {horizon_s:g} s, found by clustering driven paths. A "
            "method does not draw a path; it gives each template a probability. The label is the "
            "template nearest to the path that was driven.",
        ),
        _point(
            "Top-k",
            "share of samples whose label is among the k templates with the highest probability. "
            "Many templates are near-twins, so the second choice may be as good a plan as the "
            "label and still count as wrong; distances in metres do not have this flaw.",
        ),
        _point(
            "NLL",
            "minus the logarithm of the probability given to the label, in nats. Lower is better. "
            "It punishes being sure and wrong.",
        ),
        _point(
            "Intervals",
            f"[low, high] are 95 % intervals over {name_groups(resampled, num_groups)}: whole "
            f"{resampled} are drawn again {NUM_DRAWS} times, since samples of one {one} look "
            f"alike. They say how much a number hangs on which {resampled} were recorded here, "
            f"nothing about another training seed or another city. From few {resampled} they come "
            "out too narrow."
            + (" A log is one drive, from which scenes are cut." if one == "log" else "")
            + (f" Here is one {one} only, so there are none." if num_groups == 1 else ""),
        ),
        _point(
            "Differences",
            "are taken sample by sample, so what makes a scene hard for both cancels. Bold, with "
            "a verdict: the interval excludes zero. About one such comparison in twenty does so by "
            "chance.",
        ),
        _point(
            "L2, two conventions",
            "the distance at 3 s, and the mean of the distances up to 3 s, are both called 'L2 at "
            "3 s' in the literature, and the second is much smaller. Do not mix them.",
        ),
        _point(
            "Open loop",
            "no plan was ever driven. Each sample starts from where the driver was, and other road "
            "users do as recorded, so errors never add up as they would on a road.",
        ),
    ]
    names = [
        element(
            "li",
            element("strong", spaced(name)),
            f": {METHOD_NOTES[name]}." if name in METHOD_NOTES else "",
        )
        for name in methods
    ]
    return join(
        note(
            f"Each method gives each of {one_of} a probability. What counts is how high the one "
            "nearest to the driven path comes out."
        ),
        folded("The words, and what the numbers do not tell", element("ul", *points)),
        folded("The methods", element("ul", *names)),
    )


def _point(word: str, text: str) -> Html:
    return element("li", element("strong", word), ": ", text)
