"""Data sets in which nothing ever moves: the car stood, or lengths are no metres."""

import numpy as np

from lss_core.data.tables.tracks import Tracks

# Moves that are none.
_STILL_M = 0.5
# Less time than this may well be spent at a traffic light.
_ENOUGH_S = 5.0
_FEW = 5
_SPEEDS_MPS = (0.5, 60.0)
# Of arcs on the earth: metres in one of them, and the largest latitude and longitude.
_ARCS = {"degrees": (111_000.0, 90.0, 180.0), "radians": (6.37e6, 1.6, 3.2)}


def standing(tracks: Tracks) -> tuple[str, bool]:
    """What is measured if no scene's car moves, else empty; and whether that is a mistake for sure.

    Lengths in degrees or kilometres look like a car that creeps evenly: localisation of a car that
    stands wavers instead.

    Args:
        tracks: Of the data set.
    """
    starts, ends = tracks.starts, tracks.ends
    lasts_s = tracks.time_s[ends] - tracks.time_s[starts]
    if lasts_s.sum() < _ENOUGH_S:
        return "", False
    place = tracks.place_m[:, :2]
    spread = np.maximum.reduceat(place, starts) - np.minimum.reduceat(place, starts)
    if spread.max() > _STILL_M:
        return "", False
    measured = (
        f"in none of {len(starts)} scenes the car moves more than {spread.max():.2g} m within "
        f"{lasts_s.max():.0f} s"
    )
    way = np.hypot(*(place[ends] - place[starts]).T)
    path = np.add.reduceat(np.append(tracks.steps.moved_m, 0.0), starts)
    is_even = (way > 0.5 * path) & (way > 0.0) & (ends - starts >= _FEW) & (lasts_s > 1.0)
    speed = np.max(way[is_even] / lasts_s[is_even], initial=0.0)
    slowest, fastest = _SPEEDS_MPS
    smaller, larger = np.sort(np.abs(place).max(axis=0))
    for unit, (metres, latitude, longitude) in _ARCS.items():
        is_place = smaller <= latitude and latitude / 90.0 < larger <= longitude
        if is_place and slowest < speed * metres < fastest:
            text = f"{measured}; the translation looks like {unit} of latitude and longitude"
            return text, True
    if slowest < speed * 1e3 < fastest:
        return f"{measured}; perhaps the translation is in kilometres", False
    return measured, False
