"""The place database: stored views with their key-points and poses, asked "where was this seen?" (thesis section 5.2).

An answer is a pose in the map with covariance, or `abstained` with a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .geometry import Camera, compose_covariance, inverse, planar, wrap
from .memory import Memory, Rootsift
from .records import Features
from .retrieval import make_retrieval
from .sighting import Sighting, SightingSettings, Snapshot, sight
from .support import nearest_views, support

# The map is drawn from the very poses of the stored views; a place is as exact in it as its neighbours are.
PLACE_SIGMA_M, PLACE_SIGMA_RAD = 0.03, np.radians(0.5)
TIE, SLOPE = 0.12, 12.0  # of the support of two places, see `shares`
APART_M, APART_RAD = 1.0, np.radians(20.0)  # two sightings further apart than this are two different places


@dataclass(frozen=True)
class PlaceSettings:
    """retrieval: votes, kd_tree or vlad. checks: candidates checked by geometry. min_score: least support (rhs.support) of
    an answer. rival_share: if a second, distant place has more than this share of the best one's support, the answer is
    abstained: the two look alike."""

    retrieval: str = "vlad"
    checks: int = 5
    min_score: float = 0.02
    rival_share: float = 0.85
    sighting: SightingSettings = field(default_factory=SightingSettings)


@dataclass(frozen=True, eq=False)
class Recognised:
    """One verified candidate: the stored place, how it was seen, the pose in the map that follows, and how much of the
    view the memory explains from there (NaN for a weaker candidate of the same place)."""

    place: int
    sighting: Sighting
    map_from_body: np.ndarray
    covariance: np.ndarray
    score: float = np.nan


@dataclass(frozen=True, eq=False)
class PlaceAnswer:
    """best: the place recognised, or None when abstained, for `reason`. verified: all candidates that passed the check,
    most inliers first. distinct: the best of each different place, best supported first. ranked (T,): the candidates as
    retrieved, with their scores (T,)."""

    best: Recognised | None
    reason: str
    verified: tuple[Recognised, ...]
    distinct: tuple[Recognised, ...]
    ranked: np.ndarray
    scores: np.ndarray

    @property
    def abstained(self) -> bool:
        return self.best is None


class PlaceDatabase:
    """Answers queries over a memory."""

    def __init__(self, memory: Memory, settings: PlaceSettings, rng: np.random.Generator) -> None:
        self.memory, self._settings, self._rng = memory, settings, rng
        usable = len(memory) > 0 and len(memory.descriptors) > 0
        self.retrieval = (
            make_retrieval(settings.retrieval, Rootsift(memory.descriptors), memory.starts, rng) if usable else None
        )

    def ask(self, query: Features, camera: Camera, also: Sequence[np.ndarray] = ()) -> PlaceAnswer:
        """Where was this seen? Retrieve, check by geometry, weigh by support; abstain when nothing or too much fits.

        also: poses (4x4) believed in, whose nearest stored view is checked as well. Without this a belief would be
        contradicted by answers that never looked at it.
        """
        if self.retrieval is None or len(query.pixels) < 2:
            return _abstained("nothing stored" if self.retrieval is None else "no key-points in the view")
        ranked, scores = self.retrieval.rank(query.descriptors, 4 * self._settings.checks)
        places = dict.fromkeys([*self._spread(ranked), *(int(v) for pose in also for v in self._nearest(pose))])
        found = [self._check(place, Snapshot(query, camera)) for place in places]
        verified = tuple(sorted((item for item in found if item is not None), key=lambda r: -r.sighting.inliers))
        return self._judged(verified, Snapshot(query, camera), ranked, scores)

    def _spread(self, ranked: np.ndarray) -> list[int]:
        """The best candidates, no more than two of them from one neighbourhood: look-alikes get a hearing."""
        chosen: list[int] = []
        for place in ranked:
            same = sum(not apart(self.memory.poses[place], self.memory.poses[other]) for other in chosen)
            if same < 2:
                chosen.append(int(place))
            if len(chosen) == self._settings.checks:
                break
        return chosen

    def _nearest(self, map_from_body: np.ndarray) -> np.ndarray:
        return nearest_views(self.memory, map_from_body, 1)

    def _check(self, place: int, query: Snapshot) -> Recognised | None:
        stored = Snapshot(self.memory.features(place), self.memory.camera)
        seen = sight(stored, query, settings=self._settings.sighting, rng=self._rng)
        if seen is None:
            return None
        covariance = compose_covariance(_place_covariance(), seen.stored_from_query, seen.covariance)
        return Recognised(place, seen, self.memory.poses[place] @ seen.stored_from_query, covariance)

    def _judged(self, verified: tuple[Recognised, ...], query: Snapshot, ranked: np.ndarray, scores: np.ndarray):
        scored = [self._scored(item, query) for item in _distinct(verified)]
        distinct = tuple(sorted((r for r in scored if r.score >= self._settings.min_score), key=lambda r: -r.score))
        best, reason = None, ""
        if not distinct:
            reason = "no candidate passed the geometric check"
        elif any(rival.score > self._settings.rival_share * distinct[0].score for rival in distinct[1:]):
            reason = "two places look alike"
        else:
            best = distinct[0]
        return PlaceAnswer(best, reason, verified, distinct, ranked, scores)

    def _scored(self, item: Recognised, query: Snapshot) -> Recognised:
        return replace(item, score=support(self.memory, query.features, query.camera, item.map_from_body).score)


def _distinct(verified: Sequence[Recognised], most: int = 4) -> list[Recognised]:
    """The verified candidate with most inliers of each different place, at most `most` of them."""
    out: list[Recognised] = []
    for item in verified:
        if all(apart(item.map_from_body, other.map_from_body) for other in out):
            out.append(item)
    return out[:most]


def shares(distinct: Sequence[Recognised]) -> np.ndarray:
    """(D,) how the evidence is divided between distinct places; adds up to one.

    Places within TIE of the best support count as equal: such differences come from where the stored views happen to
    stand and keep their sign for many views, so they must not be counted view after view. Below, e-fold per 1 / SLOPE.
    """
    scores = np.array([item.score for item in distinct])
    if len(scores) == 0:
        return scores
    likely = np.exp(-SLOPE * np.maximum(1.0 - scores / scores.max() - TIE, 0.0))
    return likely / likely.sum()


def apart(pose_a: np.ndarray, pose_b: np.ndarray) -> bool:
    """Whether two poses (4x4) are different places rather than two estimates of one."""
    x_m, y_m, yaw_rad = planar(inverse(pose_a) @ pose_b)
    return bool(np.hypot(x_m, y_m) > APART_M or abs(wrap(yaw_rad)) > APART_RAD)


def _place_covariance() -> np.ndarray:
    return np.diag([PLACE_SIGMA_M**2] * 3 + [PLACE_SIGMA_RAD**2] * 3)


def _abstained(reason: str) -> PlaceAnswer:
    return PlaceAnswer(None, reason, (), (), np.empty(0, int), np.empty(0))
