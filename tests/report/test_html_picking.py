import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shoot.report.html import pick_samples


def test_by_hand() -> None:
    """Twelve samples of four scenes; NLL falls from 11 to 0."""
    nll = np.arange(11.0, -1.0, -1.0)
    scene = np.array(["a", "a", "a", "b", "b", "c", "c", "c", "c", "d", "d", "d"])
    picked = pick_samples(nll, np.arange(12), scene, num=2)
    assert picked == {"best": [11, 8], "typical": [5, 4], "worst": [0, 3]}
    still = np.arange(12) < 9
    assert pick_samples(nll, np.arange(12), scene, num=2, moving=still)["best"] == [8, 4]
    nobody = np.zeros(12, dtype=bool)
    assert pick_samples(nll, np.arange(12), scene, num=2, moving=nobody) == picked


def test_one_scene_gives_several_samples_of_it() -> None:
    picked = pick_samples(np.arange(9.0), np.zeros(9, dtype=int), np.zeros(9, dtype=int))
    assert picked == {"best": [0, 1, 2], "typical": [4, 3, 5], "worst": [8, 7, 6]}


def test_equal_nlls_are_decided_by_rank_then_position() -> None:
    picked = pick_samples(np.ones(6), np.array([2, 0, 1, 0, 2, 1]), np.arange(6), num=2)
    assert picked == {"best": [1, 3], "typical": [2, 5], "worst": [0, 4]}


@given(data=st.data())
def test_properties(data: st.DataObject) -> None:
    size = data.draw(st.integers(0, 30))
    num = data.draw(st.integers(1, 5))

    def draw(values: st.SearchStrategy[float], dtype: type) -> np.ndarray:
        return np.array(data.draw(st.lists(values, min_size=size, max_size=size)), dtype=dtype)

    nll, rank = draw(st.floats(0.0, 20.0), float), draw(st.integers(0, 9), int)
    scene, moving = draw(st.integers(0, 6), int), draw(st.booleans(), bool)
    picked = pick_samples(nll, rank, scene, num, moving)
    every = [position for group in picked.values() for position in group]
    assert len(every) == len(set(every)) <= size
    assert all(0 <= position < size for position in every)
    assert all(len(group) <= num for group in picked.values())
    if size >= 3 * num:
        assert len(picked["typical"]) == len(picked["worst"]) == num
        assert len(picked["best"]) == (min(num, moving.sum()) if moving.any() else num)
    if moving.any():
        assert moving[picked["best"]].all()
    for name, candidates in (("best", moving if moving.any() else moving | True), ("worst", None)):
        chosen = picked[name]
        if not chosen:
            continue
        first, sign = nll[chosen[0]], 1.0 if name == "best" else -1.0
        free = np.ones(size, dtype=bool) if candidates is None else candidates.copy()
        if name == "worst":
            free[picked["best"]] = False
        assert sign * first == (sign * nll[free]).min()
        # Two of one scene only if no other scene was to be had.
        if len(set(scene[chosen])) < len(chosen):
            assert set(scene[free]) == set(scene[chosen])


def test_none_at_all_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1, got 0"):
        pick_samples(np.ones(3), np.zeros(3, dtype=int), np.zeros(3, dtype=int), num=0)
