"""What is drawn lies where it is: from above, and where a camera sees it."""

import io

import numpy as np
import pytest
from film_case import GREY, NUM_STEPS, OTHER_M, make_film, make_view, without_costs
from PIL import Image

from lss_core.legible import legible
from shoot.rendering import palette
from shoot.simulation.filming import colours
from shoot.simulation.filming.bird_view import BirdView
from shoot.simulation.filming.camera_views import draw_camera
from shoot.simulation.filming.canvas import Canvas, colour
from shoot.simulation.filming.film import Film
from shoot.simulation.filming.frames import HEIGHT_PX, WIDTH_PX, draw_frames
from shoot.simulation.filming.ground import Ground, draw_ground, place
from shoot.simulation.filming.mishaps import Mishap
from shoot.simulation.filming.strip import TILE_PX, strip_jpeg

VIEW = BirdView(400, 400, px_per_m=8.0, ahead_share=0.75)


@pytest.fixture(scope="module")
def film() -> Film:
    return make_film()


@pytest.fixture(scope="module")
def ground(film: Film) -> Ground:
    return draw_ground(film.town, film.log.ego.xy_m, film.log.route_lanes, margin_m=50.0)


def pixel(picture: np.ndarray, xy_m: tuple[float, float]) -> np.ndarray:
    """At a place in `ego`."""
    x, y = np.round(place(VIEW.pixel_from_ego(), np.array(xy_m))).astype(int)
    return picture[y, x].astype(int)


def test_ahead_is_up_and_left_is_left() -> None:
    here, ahead, left = (
        place(VIEW.pixel_from_ego(), np.array(at)) for at in ((0.0, 0.0), (5.0, 0.0), (0.0, 5.0))
    )
    np.testing.assert_allclose(ahead - here, [0.0, -40.0])
    np.testing.assert_allclose(left - here, [-40.0, 0.0])
    np.testing.assert_allclose(here, [199.5, 0.75 * 399])


def test_others_the_ego_and_the_route_lie_where_they_are(film: Film, ground: Ground) -> None:
    first = VIEW.draw(film, ground, 0)
    np.testing.assert_array_equal(pixel(first, (OTHER_M[0], OTHER_M[1] + 0.5)),
                                  colour(colours.VEHICLE))  # fmt: skip
    np.testing.assert_array_equal(pixel(first, (-0.6, 0.6)), colour(palette.EGO))
    road, route = pixel(first, (15.0, -6.0)), pixel(first, (15.0, 0.0))
    np.testing.assert_allclose(road, colour(colours.ROAD), atol=2)
    assert road[0] - route[0] > 20  # greener
    # A second later it is 8 m nearer.
    later = VIEW.draw(without_costs(film), ground, 10)
    np.testing.assert_array_equal(pixel(later, (OTHER_M[0] - 8.0, OTHER_M[1] + 0.5)),
                                  colour(colours.VEHICLE))  # fmt: skip
    np.testing.assert_array_equal(pixel(later, (-4.0, 0.0)), colour(palette.DRIVEN))


def test_costs_darken_the_side_that_is_dear_and_stay_where_they_were_planned(
    film: Film, ground: Ground
) -> None:
    with_costs = VIEW.draw(film, ground, 8)
    plain = VIEW.draw(without_costs(film), ground, 8)
    darker = {at: (pixel(plain, at) - pixel(with_costs, at)).sum()
              for at in ((3.0, 5.0), (3.0, -5.0), (9.0, 5.0), (-12.5, 5.0))}  # fmt: skip
    assert darker[3.0, 5.0] > 100
    assert darker[3.0, -5.0] == 0
    # 0.4 s after planning, 3.2 m on: the map, of 10 m ahead and behind, lies that far back.
    assert darker[9.0, 5.0] == 0
    assert darker[-12.5, 5.0] > 100


def test_a_camera_sees_the_plan_on_the_ground(film: Film) -> None:
    ahead, to_the_left = (
        np.asarray(draw_camera(film, idx, make_view(), 320, 180, has_name=False), int)
        for idx in (0, 1)
    )
    # The middle column far down is the ground 4 m ahead.
    assert ahead[170, 160, 0] - ahead[170, 160, 2] > 60
    for picture in (ahead, to_the_left):
        np.testing.assert_allclose(picture[40], GREY, atol=3)  # above the horizon
    # 16 m ahead the carpet of 1.85 m lies in the middle, or 3.2 m to the left of it.
    row = 89 + round(240 * 1.5 / 16.0)
    is_orange = [picture[row, :, 0] - picture[row, :, 2] > 60 for picture in (ahead, to_the_left)]
    middle, left = slice(147, 174), slice(99, 126)
    assert [orange[middle].sum() > 20 for orange in is_orange] == [True, False]
    assert [orange[left].sum() > 20 for orange in is_orange] == [False, True]


def test_frames_are_the_same_each_time_and_tell_of_mishaps_from_then_on() -> None:
    mishap = Mishap(0.7, "hits a car, at fault", make_film().log.ego.xy_m[7])
    told = list(draw_frames(make_film(mishaps=(mishap,))))
    plain = list(draw_frames(make_film()))
    assert len(plain) == NUM_STEPS
    assert {frame.shape for frame in plain} == {(HEIGHT_PX, WIDTH_PX, 3)}
    equal = [np.array_equal(a, b) for a, b in zip(told, plain, strict=True)]
    assert equal == [step < 7 for step in range(NUM_STEPS)]


def test_without_images_the_bird_sees_more() -> None:
    frame = next(draw_frames(make_film(has_images=False)))
    road = colour(colours.ROAD)
    assert (np.abs(frame[:, :864].astype(int) - road).sum(axis=-1) <= 6).mean() > 0.4
    assert (np.abs(frame[:, 864:].astype(int) - 255).sum(axis=-1) == 0).mean() > 0.9


@pytest.mark.parametrize("has_images", [True, False])
def test_a_strip_is_a_map_and_seven_moments(has_images: bool) -> None:
    film = make_film(has_images)
    jpeg = strip_jpeg(film)
    assert jpeg == strip_jpeg(make_film(has_images))
    width_px, height_px = Image.open(io.BytesIO(jpeg)).size
    assert width_px == 8 * TILE_PX + 7 * 4
    assert height_px == (384 if has_images else 260)


def test_texts_of_any_kind_are_drawn() -> None:
    text = "nul\x00 bell\x07 half\udc80 $\\frac{1}{$"
    canvas, same = (Canvas.blank(500, 40, "#ffffff") for _ in range(2))
    canvas.text(5, 25, text, 15, palette.INK)
    same.text(5, 25, legible(text), 15, palette.INK)
    assert canvas.picture().min() < 100
    np.testing.assert_array_equal(canvas.picture(), same.picture())
