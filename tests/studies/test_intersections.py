import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from world_fixture import result_beside

from lss_core.config import DataConfig
from lss_core.errors import DataError
from shoot.studies.turn_leak.intersections import find_questions, scene_origin
from shoot.templates import TemplateSet
from shoot.training.planning.data import LabelledSplit, load_split
from shoot.world.config import CARD, VERSION, MakeWorldConfig
from shoot.world.writer import make_world


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, LabelledSplit]:
    """A few short scenes with hardly any picture in them."""
    root = tmp_path_factory.mktemp("city")
    config = MakeWorldConfig(
        out=root, train_scenes=0, val_scenes=2, duration_s=7.0, keyframe_s=1.0,
        image_scale=0.05, lidar_azimuths=8, workers=1, seed=4,
    )  # fmt: skip
    result_beside(make_world, config)
    still = TemplateSet(np.zeros((1, 20, 2), np.float32), 0.25, np.ones(1, np.int64))
    return root, load_split(DataConfig(root=str(root), version=VERSION), "val", still)


def test_the_driven_path_lies_on_the_way_taken(city: tuple[Path, LabelledSplit]) -> None:
    root, split = city
    questions = find_questions(split, root)
    assert questions
    for question in questions:
        assert str(split.scene_names[question.position]) == question.scene
        way = shapely.LineString(question.ways_m[question.taken])
        driven = shapely.points(split.futures.xy_m[question.position])
        assert np.max(shapely.distance(way, driven)) < 1.0
        assert len(set(question.directions)) == len(question.ways_m) >= 2
        # Up to the intersection all ways are one, and it begins at the ego.
        assert 0.0 <= question.distance_m < 300.0
        for way_m in question.ways_m:
            assert np.hypot(*way_m[0]) < 0.7


def test_a_world_of_another_seed_is_not_taken_for_this_one(
    city: tuple[Path, LabelledSplit], tmp_path: Path
) -> None:
    root, split = city
    card = json.loads((root / CARD).read_text())
    (tmp_path / CARD).write_text(json.dumps(card | {"seed": card["seed"] + 1}))
    with pytest.raises(DataError, match="another version of the synthetic city"):
        find_questions(split, tmp_path)
    (tmp_path / CARD).write_text(json.dumps(card | {"world_format": 0}))
    with pytest.raises(DataError, match="format 0"):
        scene_origin(tmp_path, "scene-0003")


def test_only_synthetic_scenes_can_be_made_again(
    city: tuple[Path, LabelledSplit], tmp_path: Path
) -> None:
    with pytest.raises(DataError, match=CARD):
        scene_origin(tmp_path, "scene-0003")
    with pytest.raises(DataError, match="scene-9999"):
        scene_origin(city[0], "scene-9999")


def test_scenes_of_one_town_share_it(city: tuple[Path, LabelledSplit], tmp_path: Path) -> None:
    card = json.loads((city[0] / CARD).read_text())
    (tmp_path / CARD).write_text(json.dumps(card | {"scenes_per_town": 2}))
    # The first three scenes of nuScenes' train split.
    first, second, third = (
        scene_origin(tmp_path, name) for name in ("scene-0001", "scene-0002", "scene-0004")
    )
    assert first.town_seed == second.town_seed != third.town_seed
    assert first.scene_seed != second.scene_seed
    np.testing.assert_array_equal(first.origin_m, second.origin_m)
