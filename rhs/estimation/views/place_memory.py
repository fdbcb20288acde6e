"""The memory of a survey: its stored views as plain arrays.

Descriptors are kept as bytes (512 times the RootSIFT value), so that ten thousand views of 300 key-points take 0.4 GB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rhs.api.geometry import Camera, planar
from rhs.api.records import Features, View

BYTE_SCALE = 512.0


@dataclass(frozen=True, eq=False)
class Memory:
    """Stored views as plain arrays: poses (P, 4, 4) map_from_body; indices (P,) of the views in their survey;
    starts (P + 1,) rows of the key-points of each view in pixels (M, 2), descriptors (M, 128) uint8, points (M, 3);
    greys (P, h, w) uint8: the thumbnails of the views, empty pictures when they were not kept."""

    poses: np.ndarray
    indices: np.ndarray
    starts: np.ndarray
    pixels: np.ndarray
    descriptors: np.ndarray
    points: np.ndarray
    camera: Camera
    greys: np.ndarray = field(default_factory=lambda: np.empty((0, 0, 0), np.uint8))
    explained: dict[int, float] = field(default_factory=dict, init=False, repr=False)  # score of views by their neighbours

    def __len__(self) -> int:
        return len(self.poses)

    @cached_property
    def stands(self) -> np.ndarray:
        """(P, 3) x, y, heading of the stored views."""
        return np.array([planar(pose) for pose in self.poses]).reshape(-1, 3)

    @cached_property
    def placed(self) -> np.ndarray:
        """(P,) key-points of each view whose depth is known, by which alone a pose is found: in a hall wider than the camera
        measures most have none. All of them where none has, as of one camera."""
        known = np.isfinite(self.points[:, 2])
        ends = np.concatenate([[0], np.cumsum(known if known.any() else ~known)])
        return np.diff(ends[self.starts])

    def rootsift(self, rows: np.ndarray) -> np.ndarray:
        """(N, 128) float32 descriptors of some key-points, at unit length."""
        return unpacked(self.descriptors[rows])

    def features(self, place: int) -> Features:
        """Key-points of one stored view, descriptors back at unit length."""
        rows = slice(self.starts[place], self.starts[place + 1])
        return Features(self.pixels[rows], unpacked(self.descriptors[rows]), self.points[rows])


def memory_of(views: Sequence[View]) -> Memory:
    """The stored views of a survey (those with key-points) at their corrected poses; all are taken with one camera."""
    kept = [view for view in views if view.features is not None and len(view.features.pixels) > 1]
    if not kept:
        nothing = np.empty((0, 2), np.float32)
        camera = views[0].camera if views else Camera(1, 1, 1.0, 1.0, 0.0, 0.0)
        return Memory(np.empty((0, 4, 4)), np.empty(0, int), np.zeros(1, int), nothing,
                      np.empty((0, 128), np.uint8), np.empty((0, 3), np.float32), camera)  # fmt: skip
    parts = [view.features for view in kept if view.features is not None]
    return Memory(
        poses=np.stack([view.map_from_body for view in kept]),
        indices=np.array([view.index for view in kept]),
        starts=np.concatenate([[0], np.cumsum([len(part.pixels) for part in parts])]),
        pixels=np.concatenate([part.pixels for part in parts]).astype(np.float32),
        descriptors=np.concatenate([packed(part.descriptors) for part in parts]),
        points=np.concatenate([part.points for part in parts]).astype(np.float32),
        camera=kept[0].camera,
        greys=_greys(parts),
    )


def _greys(parts: Sequence[Features]) -> np.ndarray:
    """(P, h, w) uint8 thumbnails; of no pixels unless all views have one, of the same size."""
    thumbnails = [part.thumbnail for part in parts]
    if any(g is None for g in thumbnails) or len({g.grey.shape for g in thumbnails if g is not None}) != 1:
        return np.empty((len(parts), 0, 0), np.uint8)
    return np.stack([g.grey for g in thumbnails if g is not None])


@dataclass(frozen=True, eq=False)
class Rootsift:
    """(M, 128) RootSIFT descriptors kept as bytes, `packed`; brought to unit length where they are looked at."""

    rows: np.ndarray

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, which: slice | np.ndarray) -> np.ndarray:
        return unpacked(self.rows[which])


@dataclass(frozen=True, eq=False)
class StoredDescriptors:
    """The same of views that lie in a file, of which only those looked at are read. at (P,): rows of the views; starts
    (P + 1,): rows of their descriptors."""

    views: Sequence[View]
    at: np.ndarray
    starts: np.ndarray

    def __len__(self) -> int:
        return int(self.starts[-1])

    def __getitem__(self, which: slice | np.ndarray) -> np.ndarray:
        """(N, 128) float32; which: rows in increasing order."""
        rows = np.arange(len(self))[which]
        place = np.searchsorted(self.starts, rows, side="right") - 1
        found = [self._of(k)[rows[place == k] - self.starts[k]] for k in np.unique(place).tolist()]
        return unpacked(np.concatenate(found)) if found else np.empty((0, 128), np.float32)

    def _of(self, place: int) -> np.ndarray:
        features = self.views[int(self.at[place])].features
        assert features is not None
        return packed(features.descriptors)


def packed(descriptors: np.ndarray) -> np.ndarray:
    """(N, 128) uint8 of unit-length RootSIFT descriptors."""
    return np.minimum(np.rint(descriptors * BYTE_SCALE), 255).astype(np.uint8)


def unpacked(descriptors: np.ndarray) -> np.ndarray:
    """(N, 128) float32 of unit length again."""
    rows = descriptors.astype(np.float32)
    rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
    return rows
