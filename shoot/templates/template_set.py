"""Templates: the K trajectories the planner chooses from, and the file they are kept in."""

import hashlib
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.data.drives import KnownScene
from lss_core.errors import DataError
from lss_core.files import write_atomically
from lss_core.geometry import FloatArray
from lss_core.npz import UNREADABLE, read_npz

FORMAT_VERSION = 1
# A million templates of 20 points take 160 MB; what unpacks to more is not meant well.
MAX_BYTES = 1 << 28


@dataclass(frozen=True)
class Coverage:
    """How far futures are from their nearest template: mean over the points of the distance, in m.

    Attributes:
        mean_m: Mean over futures.
        median_m: Median over futures.
        p95_m: 95th percentile.
        max_m: Worst.
        count: Number of futures.
    """

    mean_m: float
    median_m: float
    p95_m: float
    max_m: float
    count: int


@dataclass(frozen=True)
class TemplateSet:
    """K trajectories in the ego frame, with how they came to be.

    Attributes:
        points: [K, T, 2] float32 metres; x forward, y left; the first point is at `dt_s`.
        dt_s: Time between points.
        counts: [K] futures nearest to each, of those they were fitted to or counted on.
        card: Provenance, JSON values only.

    Raises:
        ValueError: If points, counts or time step are of another shape or type, or cannot be.
    """

    points: NDArray[np.float32]
    dt_s: float
    counts: NDArray[np.int64]
    card: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        points, counts = self.points, self.counts
        if points.ndim != 3 or points.shape[2] != 2 or 0 in points.shape:
            raise ValueError(f"Templates must be [K, T, 2], got {list(points.shape)}.")
        if points.dtype != np.float32 or not np.isfinite(points).all():
            raise ValueError("Templates must be finite and float32.")
        if counts.shape != points.shape[:1] or counts.dtype != np.int64 or (counts < 0).any():
            raise ValueError("Templates must have an int64 count each, 0 or more.")
        if not 0.0 < self.dt_s < math.inf:
            raise ValueError(f"dt_s must be more than 0 s, got {self.dt_s}.")

    @property
    def sha256(self) -> str:
        """Fingerprint of points and time step; a checkpoint carries it."""
        digest = hashlib.sha256(np.ascontiguousarray(self.points, dtype="<f4").tobytes())
        digest.update(f"{self.points.shape} {self.dt_s:.6f}".encode())
        return digest.hexdigest()

    @property
    def horizon_s(self) -> float:
        """Time of the last point."""
        return self.points.shape[1] * self.dt_s

    @property
    def scene_tokens(self) -> tuple[str, ...]:
        """Of the scenes they were fitted on, as far as the card tells."""
        tokens = self.card.get("scene_tokens")
        return tuple(map(str, tokens)) if isinstance(tokens, list) else ()

    @property
    def scenes(self) -> tuple[KnownScene, ...]:
        """Those they were fitted on, as far as the card tells; older ones tell tokens only.

        Raises:
            ValueError: If the card's lists do not fit each other.
        """
        tokens = self.scene_tokens
        unknown = [""] * len(tokens)
        names = self.card.get("scene_names", unknown)
        digests = self.card.get("scene_digests", unknown)
        return tuple(
            KnownScene(str(name), token, str(digest))
            for name, token, digest in zip(names, tokens, digests, strict=True)
        )

    def nearest(self, futures: FloatArray) -> NDArray[np.int64]:
        """[M] the template nearest in L2 (norm of all 2 T numbers) to each of [M, T, 2] futures.

        Paper: section 3.3.

        Raises:
            DataError: If the futures have another number of points, or are not finite.
        """
        # Slow to load, and who only plans does without.
        from sklearn.metrics import pairwise_distances_argmin

        if not np.isfinite(futures).all():
            raise DataError("Futures must be finite, but hold NaN or infinity.")
        if futures.shape[1:] != self.points.shape[1:]:
            raise DataError(
                f"Templates have {self.points.shape[1]} points, futures {futures.shape[1]}; "
                "fit templates for this horizon."
            )
        if not len(futures):
            return np.zeros(0, dtype=np.int64)
        flat = self.points.reshape(len(self.points), -1).astype(np.float64)
        nearest: NDArray[np.int64] = pairwise_distances_argmin(
            futures.reshape(len(futures), -1).astype(np.float64), flat
        )
        return nearest.astype(np.int64)

    def coverage(self, futures: FloatArray) -> Coverage:
        """Distances of [M, T, 2] futures to their nearest templates.

        Raises:
            DataError: If there is no future, or futures have another number of points.
        """
        if not len(futures):
            raise DataError("There is no trajectory to measure the coverage of templates on.")
        nearest = self.points[self.nearest(futures)]
        distance_m = np.linalg.norm(futures - nearest, axis=-1).mean(axis=-1)
        return Coverage(
            mean_m=float(distance_m.mean()),
            median_m=float(np.median(distance_m)),
            p95_m=float(np.quantile(distance_m, 0.95)),
            max_m=float(distance_m.max()),
            count=len(futures),
        )

    def save(self, path: str | Path) -> None:
        """Write `path` (.npz, no pickle), its card as JSON beside it; each whole or not at all.

        Raises:
            OSError: If one cannot be written.
        """
        path = Path(path)
        card = self.card | {"sha256": self.sha256, "format_version": FORMAT_VERSION}
        text = json.dumps(card, indent=2, sort_keys=True)
        # The card first: where there is a template file, everything is there.
        with write_atomically(path.with_suffix(".json")) as stream:
            stream.write((text + "\n").encode())
        with write_atomically(path) as stream:
            np.savez_compressed(
                stream,
                templates=self.points.astype(np.float32),
                dt_s=np.float64(self.dt_s),
                counts=self.counts.astype(np.int64),
                card=np.asarray(text),
            )

    @staticmethod
    def load(path: str | Path) -> "TemplateSet":
        """Read a template file.

        Raises:
            DataError: If the file is missing, no template file, or of another format version.
        """
        path = Path(path)
        if not path.is_file():
            raise DataError(f"There is no template file '{path}'; shoot-fit-templates makes one.")
        try:
            stored = read_npz(path, MAX_BYTES)
            points, counts = stored["templates"], stored["counts"]
            dt_s, card = float(stored["dt_s"]), json.loads(str(stored["card"]))
        except UNREADABLE as error:
            raise DataError(f"'{path}' is not a template file: {error}") from error
        if not isinstance(card, dict) or card.get("format_version") != FORMAT_VERSION:
            raise DataError(f"'{path}' is of another template format; fit it anew.")
        try:
            if points.dtype != np.float32 or counts.dtype != np.int64:
                raise ValueError(f"They are {points.dtype}, their counts {counts.dtype}.")
            templates = TemplateSet(points=points, dt_s=dt_s, counts=counts, card=card)
        except ValueError as error:
            raise DataError(
                f"'{path}' holds no [K, T, 2] float32 templates; fit it anew ({error})"
            ) from error
        try:
            templates.scenes  # noqa: B018
        except (ValueError, TypeError) as error:
            raise DataError(f"The card of '{path}' is damaged: {error}; fit it anew.") from error
        return templates
