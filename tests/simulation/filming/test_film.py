"""What a film shows of a moment, and which moments tell it."""

import numpy as np
import pytest
from film_case import TEMPLATES_M, make_film, make_plan

from shoot.simulation.filming.film import Film, rank_plan
from shoot.simulation.filming.mishaps import Mishap
from shoot.simulation.filming.strip import choose_moments


def test_the_plan_comes_first_and_what_is_masked_not_at_all() -> None:
    ranking = rank_plan(make_plan(1))
    assert ranking is not None
    np.testing.assert_allclose(ranking.probabilities, [0.3, 0.5, 0.2])
    np.testing.assert_allclose(ranking.strengths, [0.6, 1.0, 0.4])
    np.testing.assert_array_equal(ranking.paths_m[:, 1:], TEMPLATES_M[[1, 0, 2]])
    assert ranking.num_templates == 4


def test_a_plan_is_followed_until_the_next_one() -> None:
    film = make_film()
    assert [film.plan_at(step) for step in (0, 3, 4, 8, 9, 12)] == [None, None, 0, 0, 1, 1]
    assert [film.step_of_plan(idx) for idx in (0, 1)] == [4, 9]


def test_nothing_is_said_before_it_happens() -> None:
    mishaps = (Mishap(0.5, "hits a car", np.zeros(2)), Mishap(1.1, "stands", np.zeros(2)))
    film = make_film(mishaps=mishaps)
    assert [len(film.mishaps_by(step)) for step in (4, 5, 10, 11, 12)] == [0, 1, 1, 2, 2]


def test_moments_begin_and_end_with_the_drive_and_have_what_went_wrong() -> None:
    mishaps = tuple(Mishap(at_s, "", np.zeros(2)) for at_s in (0.6, 2.3, 2.4, 4.1))
    # Of the second and the third one is enough; the first is as the hand-over, at 0.4 s.
    assert choose_moments(make_film(mishaps=mishaps, num_steps=61), num=4) == [4, 23, 41, 60]
    # The widest gaps are filled: from 4.1 to 6.0 s, then from 0.4 to 2.3 s.
    moments = choose_moments(make_film(mishaps=mishaps, num_steps=61), num=6)
    assert moments == [4, 13, 23, 41, 50, 60]
    assert choose_moments(make_film(num_steps=6)) == [4, 5]


def test_views_must_be_of_all_plans() -> None:
    film = make_film()
    with pytest.raises(ValueError, match="2 plans needs views of as many, got 1"):
        Film(film.town, film.log, film.views[:1])
