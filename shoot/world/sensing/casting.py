"""Rays and what they meet first: the ground, the standing town, or something that moves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shoot.world.looks.meshes import SHADOW, Float32Array, Int32Array
from shoot.world.looks.scenery import NO_OBJECT, Solid
from shoot.world.town.town import FloatArray

SIGHT_M = 320.0
_NO_GROUND_M = 2 * SIGHT_M


@dataclass(frozen=True)
class Hits:
    """What each of P rays met.

    Attributes:
        distance_m: [P]; `SIGHT_M` and more where nothing was met.
        standing, moving: [P] face of that solid, or -1.
        is_ground: [P].
        shade: [P] share of light left by shadows of moving things on the ground.
    """

    distance_m: Float32Array
    standing: Int32Array
    moving: Int32Array
    is_ground: NDArray[np.bool_]
    shade: Float32Array


def cast(
    eye_m: FloatArray,
    rays: Float32Array,
    standing: Solid,
    moving: Solid,
    window: Int32Array | None = None,
) -> Hits:
    """Follow rays to what they meet.

    Args:
        eye_m: [3] where all rays begin, in the town's frame.
        rays: [P, 3] unit directions.
        standing: The town.
        moving: What moves.
        window: Numbers of the only rays that may meet something moving; None for all.
    """
    count = len(rays)
    height = rays[:, 2]
    ground_m = np.full(count, _NO_GROUND_M, np.float32)
    np.divide(np.float32(-eye_m[2]), height, out=ground_m, where=height < -1e-4)
    np.minimum(ground_m, _NO_GROUND_M, out=ground_m)
    on_standing, distance = trace(standing, eye_m, rays, np.minimum(ground_m, SIGHT_M))
    np.copyto(distance, ground_m, where=on_standing < 0)
    on_moving = np.full(count, -1, np.int32)
    shade = np.ones(count, np.float32)
    if moving.scene is not None and (window is None or len(window)):
        chosen = np.arange(count, dtype=np.int32) if window is None else window
        reach = np.minimum(distance[chosen], SIGHT_M)
        face, met_m = trace(moving, eye_m, rays[chosen], reach)
        is_shadow = (face >= 0) & (moving.mesh.material[face] == SHADOW)
        dark = chosen[is_shadow]
        lies_open = on_standing[dark] < 0
        shade[dark[lies_open]] = moving.lit_rgb[0, face[is_shadow][lies_open]]
        is_solid = (face >= 0) & ~is_shadow
        hidden = chosen[is_solid]
        on_moving[hidden], distance[hidden], on_standing[hidden] = (
            face[is_solid],
            met_m[is_solid],
            -1,
        )
    is_ground = (on_standing < 0) & (on_moving < 0) & (distance < SIGHT_M)
    return Hits(distance, on_standing, on_moving, is_ground, shade)


def trace(
    solid: Solid, eye_m: FloatArray, rays: Float32Array, reach_m: Float32Array
) -> tuple[Int32Array, Float32Array]:
    """First face each ray [P, 3] meets within its reach (-1 for none), and how far away."""
    if solid.scene is None:
        return np.full(len(rays), -1, np.int32), np.array(reach_m, np.float32)
    origins = np.empty((len(rays), 3), np.float32)
    origins[:] = eye_m
    reach = np.array(reach_m, np.float32)
    met = solid.scene.run(origins, np.ascontiguousarray(rays), dists=reach, output=1)
    return met["primID"], met["tfar"]


def objects_met(hits: Hits, standing: Solid, moving: Solid) -> Int32Array:
    """Object each ray met ([P]), `NO_OBJECT` for scenery and nothing."""
    objects = np.full(len(hits.distance_m), NO_OBJECT, np.int32)
    for faces, solid in ((hits.standing, standing), (hits.moving, moving)):
        met = np.flatnonzero(faces >= 0)
        objects[met] = solid.object_of_face[faces[met]]
    return objects
