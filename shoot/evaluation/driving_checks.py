"""Whether a path hits an annotated box or leaves the drivable area, per sample and horizon.

Collision within h seconds: at one of the path's times up to h the ego's footprint, a rectangle that
turns with the path, overlaps the box of a vehicle or of a person. The box moves as it was recorded:
at a time between two of its annotations its position is interpolated linearly, its heading along
the shorter way; outside of its annotated time it is not there. Others drive on as they did,
whatever the path does: a car behind may drive into an ego that is slower than the driver was, and
that counts as well. A sample whose scene is not annotated up to h seconds after it (0.25 s may be
missing) has no value, nor has one of a scene without a single annotation of a category that is
known, or of one whose boxes have no tracks: between keyframes nobody would be there.

Boxes that the driver's own footprint overlaps, at the sample or at a time of the driven path, are
left out for that sample, for the whole path: the driver hit nothing, so these boxes are inexact.
The driven path itself therefore never collides, by construction; how many boxes were left out says
how far to trust that. Deviation: others skip time steps instead, see docs/deviations.md.

Off-road within h seconds: at one of the path's times up to h one of the footprint's four corners
lies outside the drivable area of the map. The driven path has no exemption here. Where the map has
no drivable area at all there is no value.

What cannot be told is absent, never zero: `DrivingChecks.basis` says what the rates rest on. Nor is
there a rate within h seconds of paths that have no point at h.
"""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from lss_core.config import DataConfig
from lss_core.data.annotations.boxes import Boxes, has_annotations, read_boxes
from lss_core.data.annotations.drivable import DrivableArea, load_drivable_area
from lss_core.data.annotations.map_file import has_map
from lss_core.data.samples import SampleIndex
from lss_core.geometry import yaw_of
from lss_core.legible import legible
from shoot.evaluation.box_moments import BoxMoments, find_moments, touched
from shoot.evaluation.check_basis import CheckBasis
from shoot.footprint import footprint_corners, headings, turn
from shoot.training.planning.data import LabelledSplit
from shoot.trajectories import whole_steps

Array = np.ndarray[Any, np.dtype[Any]]

logger = logging.getLogger(__name__)

CHECK_HORIZONS_S = (1, 2, 3, 5)
# A path's last time may lie this much beyond the last annotated keyframe.
MISSING_S = 0.25
_MOSTLY = 0.5
_NAMED = 4


class DrivingChecks:
    """Collision and off-road of one path for each sample of a split, in per cent (0 or 100).

    What the data set cannot tell is left out, with a warning: `collision_*` without annotations of
    known categories or without tracks, `off_road_*` without map expansion.

    Args:
        split: Its samples and their driven paths.
        data: Where its tables and maps are.

    Attributes:
        num_boxes_left_out: Boxes that the driver's footprint overlaps; an object counts once for
            each sample.
        num_samples_affected: Samples with such a box.
        basis: What the rates rest on, and why they are left out where they are.

    Raises:
        DataError: If a table or a map is damaged, an object has two boxes at one sample, or the
            maps of some locations are missing.
    """

    def __init__(self, split: LabelledSplit, data: DataConfig) -> None:
        index, self._sample = split.index, split.futures.sample
        self._paths_shape, self._dt_s = split.futures.xy_m.shape, split.futures.dt_s
        pose = index.global_from_ego[self._sample]
        self._xy_m, self._yaw_rad = pose[:, :2, 3], yaw_of(pose)
        self._location = index.scene_location[index.sample_scene[self._sample]]
        self._areas, no_off_road = _load_areas(Path(data.root), np.unique(self._location).tolist())
        self.num_boxes_left_out = self.num_samples_affected = 0
        self._moments: BoxMoments | None = None
        self._known_s = np.zeros(len(self._sample))
        scene = index.sample_scene[self._sample]
        boxes, no_collisions = _read_boxes(Path(data.root) / data.version, index, np.unique(scene))
        self.basis = self._with_map(CheckBasis(len(scene)), no_off_road)
        if boxes is None or no_collisions:
            unknown = {} if boxes is None else boxes.num_unknown
            logger.warning("%s: collisions are left out.", legible(_capitalised(no_collisions)))
            self.basis = replace(self.basis, no_collisions=no_collisions, unknown=unknown)
            return
        self._known_s = np.where(
            boxes.annotated[scene], _last_keyframe_s(index)[scene] - index.time_s[self._sample], 0.0
        )
        self.basis = replace(
            self.basis,
            num_samples_with_boxes=int(boxes.annotated[scene].sum()),
            boxes=boxes.num_objects,
            unknown=boxes.num_unknown,
        )
        # The sample's own moment comes first, where the driver is at the origin.
        ahead_s = self._dt_s * np.arange(self._paths_shape[1] + 1)
        moments = find_moments(
            boxes, scene, index.time_s[self._sample], self._xy_m, self._yaw_rad, ahead_s
        )
        self._moments = self._without_inexact(moments, split.futures.xy_m)

    def __call__(self, paths_m: Float[Array, "S T 2"]) -> dict[str, Float[Array, " S"]]:
        """Each check of each sample in per cent, 0 or 100; NaN where it is not known.

        Args:
            paths_m: One path for each sample of the split, in its order, at the times of the
                driven ones, in metres in `ego`.

        Returns:
            `collision_1s`, `off_road_1s` and so on, as far as the data set can tell.

        Raises:
            ValueError: If the paths have another shape than the driven ones.
        """
        if paths_m.shape != self._paths_shape:
            raise ValueError(
                f"Expected paths of shape {self._paths_shape}, as the driven ones have, got "
                f"{paths_m.shape}."
            )
        heading_rad = headings(paths_m, self._dt_s)
        checks: dict[str, Array] = {}
        if self._moments is not None:
            collides = self._collides(self._moments, paths_m, heading_rad)
            for horizon_s, values in _within(collides, self._dt_s).items():
                known = self._known_s >= horizon_s - MISSING_S - 1e-6
                checks[f"collision_{horizon_s}s"] = np.where(known, values, np.nan)
        if self._areas is not None:
            off_road = self._is_off_road(self._areas, paths_m, heading_rad)
            for horizon_s, values in _within(off_road, self._dt_s).items():
                checks[f"off_road_{horizon_s}s"] = np.where(self._has_map(), values, np.nan)
        return checks

    def _has_map(self) -> Bool[Array, " S"]:
        return np.isin(self._location, list(self._areas or ()))

    def _with_map(self, basis: CheckBasis, no_off_road: str) -> CheckBasis:
        """The basis, with what is known of the road; warns where the car itself is off it."""
        if self._areas is None:
            logger.warning("%s: off-road rates are left out.", legible(_capitalised(no_off_road)))
            return replace(basis, no_off_road=no_off_road)
        num_on_road, num_known = 0, int(self._has_map().sum())
        for location, area in self._areas.items():
            own_m = self._xy_m[self._location == location]
            num_on_road += int(area.contains(own_m[:, None]).sum())
        if num_on_road < _MOSTLY * num_known:
            logger.warning(
                "The car itself is on drivable area at %d of %d samples only: do the maps belong "
                "to these poses? Off-road rates mean little.",
                num_on_road,
                num_known,
            )
        return replace(basis, num_samples_on_road=num_on_road, num_samples_with_map=num_known)

    def _without_inexact(self, moments: BoxMoments, driven_m: Float[Array, "S T 2"]) -> BoxMoments:
        """Without the boxes that the driver overlaps, and without the samples' own moments."""
        driven_m = np.concatenate([np.zeros_like(driven_m[:, :1]), driven_m], axis=1)
        heading_rad = headings(driven_m[:, 1:], self._dt_s)
        heading_rad = np.concatenate([np.zeros_like(heading_rad[:, :1]), heading_rad], axis=1)
        hit = touched(moments, driven_m, heading_rad)
        # Pairs of sample and box as one number each.
        pair = moments.sample.astype(np.int64) << 32 | moments.box
        inexact = np.unique(pair[hit])
        self.num_boxes_left_out = len(inexact)
        self.num_samples_affected = len(np.unique(inexact >> 32))
        kept = moments.select((moments.step > 0) & ~np.isin(pair, inexact))
        return replace(kept, step=kept.step - 1)

    def _collides(
        self,
        moments: BoxMoments,
        paths_m: Float[Array, "S T 2"],
        heading_rad: Float[Array, "S T"],
    ) -> Bool[Array, "S T"]:
        hit = touched(moments, paths_m, heading_rad)
        collides = np.zeros(heading_rad.shape, dtype=bool)
        collides[moments.sample[hit], moments.step[hit]] = True
        return collides

    def _is_off_road(
        self,
        areas: dict[str, DrivableArea],
        paths_m: Float[Array, "S T 2"],
        heading_rad: Float[Array, "S T"],
    ) -> Bool[Array, "S T"]:
        is_off_road = np.zeros(heading_rad.shape, dtype=bool)
        for location, area in areas.items():
            rows = np.flatnonzero(self._location == location)
            corners_m = footprint_corners(paths_m[rows], heading_rad[rows])
            corners_m = turn(corners_m, self._yaw_rad[rows, None, None])
            inside = area.contains(corners_m + self._xy_m[rows, None, None])
            is_off_road[rows] = ~inside.all(axis=-1)
        return is_off_road


def _read_boxes(
    folder: Path, index: SampleIndex, scenes: Int[Array, " C"]
) -> tuple[Boxes | None, str]:
    """Boxes of these scenes, those without tracks not `annotated`; or why there are none."""
    if not has_annotations(folder):
        return None, f"no table of annotations in {folder.name}"
    boxes = read_boxes(folder, index, scenes)
    if not boxes.num_annotations:
        return None, f"no annotation of these scenes in {folder.name}"
    unknown = boxes.num_unknown
    names = ", ".join(list(unknown)[:_NAMED]) + (", ..." if len(unknown) > _NAMED else "")
    if not boxes.annotated.any():
        return boxes, f"no boxes of known categories ({names})"
    if unknown:
        logger.warning(
            "%d annotations are of categories that nobody here knows, and do not count in "
            "collisions: %s.",
            sum(unknown.values()),
            legible(", ".join(f"{name} ({num})" for name, num in unknown.items())),
        )
    if boxes.num_twins:
        logger.warning(
            "%d boxes lie in the very place of another one: is an object there twice?",
            boxes.num_twins,
        )
    untracked = [scene for scene in scenes.tolist() if boxes.lacks_tracks(scene)]
    annotated = boxes.annotated.copy()
    annotated[untracked] = False
    why = "boxes without tracks (each object has another instance in each sample)"
    if not annotated.any():
        return boxes, why
    if untracked:
        logger.warning(
            "%d of %d scenes have %s: collisions are left out there, as in scene %s.",
            len(untracked),
            len(scenes),
            why,
            legible(str(index.scene_name[untracked[0]])),
        )
    return boxes.only_scenes(annotated), ""


def _load_areas(root: Path, locations: list[str]) -> tuple[dict[str, DrivableArea] | None, str]:
    """Drivable areas by location, or why there are none."""
    named = ", ".join(locations)
    if not any(has_map(root, location) for location in locations):
        return None, f"no map expansion of {named}"
    areas = {location: load_drivable_area(root, location) for location in locations}
    empty = [location for location, area in areas.items() if not len(area.polygons)]
    if len(empty) == len(areas):
        return None, f"no drivable area in the maps of {named}"
    if empty:
        logger.warning(
            "The maps of %s have no drivable area: off-road rates are left out there.",
            legible(", ".join(empty)),
        )
    return {location: area for location, area in areas.items() if location not in empty}, ""


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _last_keyframe_s(index: SampleIndex) -> Float[Array, " C"]:
    """Time of each scene's last keyframe: nuScenes annotates all."""
    last_s = np.full(len(index.scene_name), -np.inf)
    np.maximum.at(last_s, index.sample_scene, index.time_s)
    return last_s


def _within(happens: Bool[Array, "S T"], dt_s: float) -> dict[int, Float[Array, " S"]]:
    """By horizon that is a time of the paths: 100 where it happens up to it, else 0."""
    num_steps = {horizon_s: whole_steps(float(horizon_s), dt_s) for horizon_s in CHECK_HORIZONS_S}
    return {
        horizon_s: 100.0 * happens[:, :num].any(axis=1)
        for horizon_s, num in num_steps.items()
        if num is not None and num <= happens.shape[1]
    }
