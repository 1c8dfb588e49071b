"""The loss of Neural Motion Planner: what was driven must cost less than all else, by a margin."""

from jaxtyping import Float
from torch import Tensor


def max_margin_loss(
    driven_cost: Float[Tensor, "B T"],
    cost: Float[Tensor, "B K T"],
    distance_m: Float[Tensor, "B K T"],
    margin_per_m: float,
) -> Float[Tensor, ""]:
    """Mean over samples of how far the worst of K trajectories is from keeping the margin.

    At each time a trajectory's waypoint must cost more than the driven one, by a margin that grows
    with the distance between them; what it falls short by is summed over times. The trajectory that
    falls short most is the sample's loss, and 0 is the least.

    Paper: section 3.3 has cross-entropy instead; this is the loss of Zeng et al., "End-to-end
    Interpretable Neural Motion Planner" (CVPR 2019), that it names. Deviation: without their cost
    of traffic rules, see docs/deviations.md.

    Args:
        driven_cost: Cost at the waypoints of what was driven.
        cost: Cost at those of the trajectories it is compared with.
        distance_m: Between waypoints of the same time, driven and not.
        margin_per_m: Margin at a metre's distance.

    Returns:
        Differentiable in costs; its gradient reaches the driven and the worst trajectory only.
    """
    # Cut off at 0 for each time, so that no time makes up for another one.
    short = (driven_cost[:, None] - cost + margin_per_m * distance_m).clamp(min=0.0).sum(dim=-1)
    return short.amax(dim=1).mean()
