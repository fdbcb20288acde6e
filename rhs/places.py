"""The place database: stored views with their key-points and poses, asked "where was this seen?" (thesis section 5.2).

An answer is a pose in the map with covariance, or `abstained` with a reason. Descriptors are kept as bytes (512 times
the RootSIFT value), so that ten thousand views of 300 key-points take 0.4 GB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .errors import RecordingError
from .geometry import Camera, compose_covariance, inverse, planar, wrap
from .records import Features, View
from .retrieval import make_retrieval
from .sighting import Sighting, SightingSettings, Snapshot, sight

BYTE_SCALE = 512.0
# The map is drawn from the very poses of the stored views; a place is as exact in it as its neighbours are.
PLACE_SIGMA_M, PLACE_SIGMA_RAD = 0.03, np.radians(0.5)
APART_M, APART_RAD = 1.0, np.radians(20.0)  # two sightings further apart than this are two different places
FORMAT = 1


@dataclass(frozen=True)
class PlaceSettings:
    """retrieval: votes, kd_tree or vlad. checks: best candidates checked by geometry. rival_share: if a second, distant
    place gathers more than this share of the best one's inliers, the answer is abstained: the two look alike."""

    retrieval: str = "vlad"
    checks: int = 5
    rival_share: float = 0.6
    sighting: SightingSettings = field(default_factory=SightingSettings)


@dataclass(frozen=True, eq=False)
class Memory:
    """Stored views as plain arrays: poses (P, 4, 4) map_from_body; indices (P,) of the views in their survey;
    starts (P + 1,) rows of the key-points of each view in pixels (M, 2), descriptors (M, 128) uint8, points (M, 3)."""

    poses: np.ndarray
    indices: np.ndarray
    starts: np.ndarray
    pixels: np.ndarray
    descriptors: np.ndarray
    points: np.ndarray
    camera: Camera

    def __len__(self) -> int:
        return len(self.poses)

    def features(self, place: int) -> Features:
        """Key-points of one stored view, descriptors back at unit length."""
        rows = slice(self.starts[place], self.starts[place + 1])
        return Features(self.pixels[rows], unpacked(self.descriptors[rows]), self.points[rows])


@dataclass(frozen=True, eq=False)
class Recognised:
    """One verified candidate: the stored place, how it was seen, and the pose in the map that follows."""

    place: int
    sighting: Sighting
    map_from_body: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class PlaceAnswer:
    """best: the place recognised, or None when abstained, for `reason`. verified: all candidates that passed the check,
    most inliers first. ranked (T,): the candidates as retrieved, with their scores (T,)."""

    best: Recognised | None
    reason: str
    verified: tuple[Recognised, ...]
    ranked: np.ndarray
    scores: np.ndarray

    @property
    def abstained(self) -> bool:
        return self.best is None

    @property
    def distinct(self) -> tuple[Recognised, ...]:
        """The best verified candidate of each different place."""
        out: list[Recognised] = []
        for item in self.verified:
            if all(apart(item.map_from_body, other.map_from_body) for other in out):
                out.append(item)
        return tuple(out)


class PlaceDatabase:
    """Answers queries over a memory."""

    def __init__(self, memory: Memory, settings: PlaceSettings, rng: np.random.Generator) -> None:
        self.memory, self._settings, self._rng = memory, settings, rng
        usable = len(memory) > 0 and len(memory.descriptors) > 0
        self.retrieval = (
            make_retrieval(settings.retrieval, unpacked(memory.descriptors), memory.starts, rng) if usable else None
        )

    def ask(self, query: Features, camera: Camera) -> PlaceAnswer:
        """Where was this seen? Retrieve, check by geometry, and abstain when nothing or too much fits."""
        if self.retrieval is None or len(query.pixels) < 2:
            return _abstained("nothing stored" if self.retrieval is None else "no key-points in the view")
        ranked, scores = self.retrieval.rank(query.descriptors, self._settings.checks)
        found = [self._check(int(place), Snapshot(query, camera)) for place in ranked]
        verified = tuple(sorted((item for item in found if item is not None), key=lambda r: -r.sighting.inliers))
        return self._judged(verified, ranked, scores)

    def _check(self, place: int, query: Snapshot) -> Recognised | None:
        stored = Snapshot(self.memory.features(place), self.memory.camera)
        seen = sight(stored, query, settings=self._settings.sighting, rng=self._rng)
        if seen is None:
            return None
        covariance = compose_covariance(_place_covariance(), seen.stored_from_query, seen.covariance)
        return Recognised(place, seen, self.memory.poses[place] @ seen.stored_from_query, covariance)

    def _judged(self, verified: tuple[Recognised, ...], ranked: np.ndarray, scores: np.ndarray) -> PlaceAnswer:
        if not verified:
            return PlaceAnswer(None, "no candidate passed the geometric check", verified, ranked, scores)
        best = verified[0]
        limit = self._settings.rival_share * best.sighting.inliers
        rivals = [r for r in verified[1:] if r.sighting.inliers > limit and apart(r.map_from_body, best.map_from_body)]
        if rivals:
            return PlaceAnswer(None, "two places look alike", verified, ranked, scores)
        return PlaceAnswer(best, "", verified, ranked, scores)


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
    )


def packed(descriptors: np.ndarray) -> np.ndarray:
    """(N, 128) uint8 of unit-length RootSIFT descriptors."""
    return np.minimum(np.rint(descriptors * BYTE_SCALE), 255).astype(np.uint8)


def unpacked(descriptors: np.ndarray) -> np.ndarray:
    """(N, 128) float32 of unit length again."""
    rows = descriptors.astype(np.float32)
    rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
    return rows


def apart(pose_a: np.ndarray, pose_b: np.ndarray) -> bool:
    """Whether two poses (4x4) are different places rather than two estimates of one."""
    x_m, y_m, yaw_rad = planar(inverse(pose_a) @ pose_b)
    return bool(np.hypot(x_m, y_m) > APART_M or abs(wrap(yaw_rad)) > APART_RAD)


def save(memory: Memory, path: Path) -> None:
    """Write a memory as plain arrays (npz without pickle)."""
    camera = memory.camera
    numbers = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, camera.skew]
    scratch = path.with_name(path.name + ".tmp-save.npz")
    np.savez_compressed(
        scratch, format=np.array(FORMAT), poses=memory.poses, indices=memory.indices, starts=memory.starts,
        pixels=memory.pixels, descriptors=memory.descriptors, points=memory.points, camera=np.array(numbers, float),
        distortion=np.array(camera.distortion, float), body_from_camera=camera.body_from_camera,
    )  # fmt: skip
    scratch.replace(path)


def load(path: Path) -> Memory:
    """Read a memory written by `save`. Raises RecordingError naming the file when it is not one."""
    try:
        with np.load(path, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
        if int(data["format"]) != FORMAT:
            raise ValueError(f"format {int(data['format'])}, expected {FORMAT}")
        memory = Memory(**{name: data[name] for name in _ARRAYS}, camera=_camera_of(data))
        _check_sizes(memory)
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise RecordingError(f"{path} is not a place database: {error}; write one with rhs.places.save") from error
    return memory


def _camera_of(data: dict[str, np.ndarray]) -> Camera:
    width, height, fx, fy, cx, cy, skew = data["camera"].tolist()
    distortion = tuple(data["distortion"].tolist())
    return Camera(int(width), int(height), fx, fy, cx, cy, skew, distortion, data["body_from_camera"])


_ARRAYS = ("poses", "indices", "starts", "pixels", "descriptors", "points")


def _check_sizes(memory: Memory) -> None:
    places, rows = len(memory.poses), len(memory.descriptors)
    steps = np.diff(memory.starts)
    if len(memory.starts) != places + 1 or memory.starts[0] != 0 or memory.starts[-1] != rows or np.any(steps < 0):
        raise ValueError("its rows do not add up")
    if len(memory.pixels) != rows or len(memory.points) != rows or len(memory.indices) != places:
        raise ValueError("its arrays differ in length")


def _place_covariance() -> np.ndarray:
    return np.diag([PLACE_SIGMA_M**2] * 3 + [PLACE_SIGMA_RAD**2] * 3)


def _abstained(reason: str) -> PlaceAnswer:
    return PlaceAnswer(None, reason, (), np.empty(0, int), np.empty(0))
