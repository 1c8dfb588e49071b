"""Which scenes have boxes without tracks: every object seen once, though it is there again."""

import itertools

import numpy as np
from numpy.typing import NDArray

from lss_core.data.tables.problems import MAX_STEP_S
from lss_core.geometry import FloatArray

# Nobody goes faster; parked cars side by side may be taken for one, which does no harm.
_SPEED_MPS, _SLACK_M = 40.0, 1.0
_SHARE = 0.5


def lacks_tracks(
    time_s: FloatArray,
    xy_m: FloatArray,
    category: NDArray[np.character],
    num_annotations: NDArray[np.int64],
) -> bool:
    """Whether most objects of a scene are annotated once and go on, it seems, under other names.

    Where an object is known at one time only, nobody is there between keyframes, and hardly anybody
    is hit. Such an object goes on if at the next annotated keyframe, or was there at the one before
    it, another of its category is within reach that is annotated once, too. With tracks few objects
    are like that.

    Args:
        time_s: [I] of each object's first annotation.
        xy_m: [I, 2] its place then.
        category: [I].
        num_annotations: [I] of each object.
    """
    alone = np.flatnonzero(num_annotations == 1)
    goes_on = np.zeros(len(time_s), dtype=bool)
    times = np.unique(time_s[alone])
    for now_s, next_s in itertools.pairwise(times.tolist()):
        if next_s - now_s > MAX_STEP_S:
            continue
        here, there = alone[time_s[alone] == now_s], alone[time_s[alone] == next_s]
        apart_m = np.linalg.norm(xy_m[here, None] - xy_m[there], axis=-1)
        near = apart_m <= _SLACK_M + _SPEED_MPS * (next_s - now_s)
        near &= category[here, None] == category[there]
        goes_on[here] |= near.any(axis=1)
        goes_on[there] |= near.any(axis=0)
    return bool(goes_on.sum() > _SHARE * len(time_s))
