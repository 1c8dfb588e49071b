import numpy as np

from lss_core.data.writing.table_rows import token
from shoot.world.nuscenes.tiling import TILE_M, tile_of


def test_towns_never_share_a_place():
    places = [tile_of("train", i) for i in range(700)] + [tile_of("val", i) for i in range(150)]
    assert len(set(places)) == 850
    # The first of them fit into the smallest real map (1585.6 x 2025 m).
    for tile in places[:60] + places[700:720]:
        assert np.all(tile.origin_m + TILE_M <= [1585.6, 2025.0])


def test_tokens_are_stable():
    assert token("scene", 1) == token("scene", 1)
    assert len({token("scene", i) for i in range(100)}) == 100
    assert len(token("a")) == 32
