import numpy as np
import pytest

from shoot.world.looks.meshes import ball, box, join, tube
from shoot.world.looks.pedestrians import pedestrian
from shoot.world.looks.vehicles import car, truck


@pytest.mark.parametrize(
    "mesh",
    [
        box((1.0, 2.0, 3.0), (1.0, 2.0, 0.5), np.ones(3, np.float32)),
        tube((0.0, 0.0, 0.0), (1.0, 1.0, 2.0), (0.5, 0.2), np.ones(3, np.float32)),
        ball((0.0, 0.0, 5.0), 2.0, np.ones(3, np.float32), 1),
    ],
)
def test_solids_are_closed_and_face_outward(mesh):
    corners = mesh.vertices_m[mesh.faces]
    middle = mesh.vertices_m.mean(axis=0)
    outward = np.sum((corners.mean(axis=1) - middle) * mesh.normals(), axis=1)
    assert np.all(outward > 0)
    edges = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    forward = {tuple(edge) for edge in edges.tolist()}
    assert len(forward) == len(edges)
    assert forward == {(b, a) for a, b in forward}


def test_models_stay_in_their_boxes():
    size = (4.6, 1.9, 1.6)
    shapes = [car(*size, style) for style in range(0, 36, 5)]
    shapes += [truck(*size, style) for style in range(3)]
    shapes += [
        pedestrian(0.6, 0.7, 1.8, style, stride) for style in range(5) for stride in (-1, 0, 1)
    ]
    for shape in shapes:
        allowed = (0.3, 0.35, 1.8) if len(shape.faces) < 100 else (2.3, 0.95, 1.6)
        over = np.abs(shape.vertices_m).max(axis=0) - allowed
        assert np.all(over < 0.011)
        assert shape.vertices_m[:, 2].min() > -1e-6


def test_joining_nothing_gives_nothing():
    assert len(join([]).faces) == 0
