"""The place database: stored views with their key-points and poses, asked "where was this seen?" (thesis section 5.2).

An answer is a pose in the map with covariance, or `abstained` with a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rhs.api.geometry import Camera, compose_covariance, inverse, planar, wrap
from rhs.api.records import Features

from .place_memory import Memory, Rootsift
from .retrieval import make_retrieval
from .thumbnails import Blocks, Fit, blocks, fit, outdoes
from .view_pose import Sighting, SightingSettings, Snapshot, sight
from .view_support import nearest_views, support

# The map is drawn from the very poses of the stored views; a place is as exact in it as its neighbours are.
PLACE_SIGMA_M, PLACE_SIGMA_RAD = 0.03, np.radians(0.5)
TIE, SLOPE = 0.12, 12.0  # of the support of two places, see `shares`
MOST = 4  # different places whose support is asked for
APART_M, APART_RAD = 1.0, np.radians(20.0)  # two sightings further apart than this are two different places


@dataclass(frozen=True)
class PlaceSettings:
    """retrieval: votes, kd_tree or vlad. checks: candidates checked by geometry. min_score: least support (rhs.support) of
    an answer. rival_share: if a second, distant place has more than this share of the best one's support, the answer is
    abstained: the two look alike.

    Where views are kept at a glance (rhs.glances): a place fits up to `misfit`, and refutes places that fit worse by `level`
    sigmas (3.1: by chance once in 1,000). One that does not fit is no answer with fewer than misfit_inliers agreeing
    key-points; pictures of real cameras seldom fit, but many key-points agree in them. If none fits, a second look asks
    faint_checks candidates whether they fit with no more than faint_inliers agreeing key-points: worth its time (it doubles
    a query that finds nothing) for a view asked alone; a robot on its way asks with its next view, so 0 by default."""

    retrieval: str = "vlad"
    checks: int = 5
    min_score: float = 0.02
    rival_share: float = 0.85
    misfit: float = 1.5
    level: float = 3.1
    misfit_inliers: int = 30
    faint_inliers: int = 6
    faint_checks: int = 0
    sighting: SightingSettings = field(default_factory=SightingSettings)


@dataclass(frozen=True, eq=False)
class Recognised:
    """One verified candidate: the stored place, how it was seen, the pose in the map that follows, how much of the view
    the memory explains from there (NaN for a weaker candidate of the same place), and how the picture fits, where known."""

    place: int
    sighting: Sighting
    map_from_body: np.ndarray
    covariance: np.ndarray
    score: float = np.nan
    fit: Fit | None = None

    def fits(self, limit: float) -> bool:
        """Whether the picture is known to look as it must from here; never true of one that cannot be compared."""
        return self.fit is not None and self.fit.misfit <= limit


@dataclass(frozen=True, eq=False)
class PlaceAnswer:
    """best: the place recognised, or None when abstained, for `reason`. verified: the best candidate of each different place
    that passed the check, most inliers first. distinct: those of them that the picture does not refute, best supported
    first. ranked (T,): the candidates as retrieved, with their scores (T,)."""

    best: Recognised | None
    reason: str
    verified: tuple[Recognised, ...]
    distinct: tuple[Recognised, ...]
    ranked: np.ndarray
    scores: np.ndarray

    @property
    def abstained(self) -> bool:
        return self.best is None


@dataclass(frozen=True, eq=False)
class _Asked:
    """A view that is asked: its key-points and its blocks."""

    snapshot: Snapshot
    blocks: Blocks | None


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
        ranked, scores = self.retrieval.rank(query.descriptors, 4 * max(self._settings.checks, self._settings.faint_checks))
        believed = [int(view) for pose in also for view in nearest_views(self.memory, pose, 1)]
        view = _Asked(Snapshot(query, camera), blocks(query.glance, camera))
        likely = self._likely([*self._spread(ranked, self._settings.checks), *believed], view, self._settings.sighting)
        comparable = view.blocks is not None and self.memory.greys.size > 0
        if self._settings.faint_checks > 0 and comparable and not any(map(self._fits, likely)):
            faint = replace(self._settings.sighting, min_inliers=self._settings.faint_inliers)
            more = self._likely([*self._spread(ranked, self._settings.faint_checks), *believed], view, faint)
            likely = [item for item in more if self._enough(item) or self._fits(item)]
        return self._judged(likely, ranked, scores)

    def _spread(self, ranked: np.ndarray, most: int) -> list[int]:
        """The best candidates, no more than two of them from one neighbourhood: look-alikes get a hearing."""
        chosen: list[int] = []
        for place in ranked:
            same = sum(not apart(self.memory.poses[place], self.memory.poses[other]) for other in chosen)
            if same < 2:
                chosen.append(int(place))
            if len(chosen) == most:
                break
        return chosen

    def _likely(self, places: Sequence[int], view: _Asked, sighting: SightingSettings) -> list[Recognised]:
        """Different places among candidates that enough key-points agree on, with support and fit; most inliers first."""
        found = [self._check(place, view.snapshot, sighting) for place in dict.fromkeys(places)]
        passed = sorted((item for item in found if item is not None), key=lambda r: -r.sighting.inliers)
        looked = [self._looked(item, view) for item in _distinct(passed, MOST)]
        return [item for item in looked if item.score >= self._settings.min_score]

    def _check(self, place: int, query: Snapshot, sighting: SightingSettings) -> Recognised | None:
        stored = Snapshot(self.memory.features(place), self.memory.camera)
        seen = sight(stored, query, settings=sighting, rng=self._rng)
        if seen is None:
            return None
        covariance = compose_covariance(_place_covariance(), seen.stored_from_query, seen.covariance)
        return Recognised(place, seen, self.memory.poses[place] @ seen.stored_from_query, covariance)

    def _judged(self, likely: Sequence[Recognised], ranked: np.ndarray, scores: np.ndarray) -> PlaceAnswer:
        fitting = [item for item in likely if self._fits(item)]
        left = [r for r in likely if not any(outdoes(other.fit, r.fit) > self._settings.level for other in fitting)]
        distinct = tuple(sorted(left, key=lambda r: -r.score))
        best, reason = None, ""
        if not distinct:
            reason = "no candidate passed the geometric check"
        elif any(rival.score > self._settings.rival_share * distinct[0].score for rival in distinct[1:]):
            reason = "two places look alike"
        elif self._doubtful(distinct[0]):
            reason = "the picture does not look like the place"
        else:
            best = distinct[0]
        return PlaceAnswer(best, reason, tuple(likely), distinct, ranked, scores)

    def _looked(self, item: Recognised, view: _Asked) -> Recognised:
        """The candidate with its support and with how the picture fits there."""
        score = support(self.memory, view.snapshot.features, view.snapshot.camera, item.map_from_body).score
        return replace(item, score=score, fit=fit(self.memory, view.blocks, item.map_from_body))

    def _enough(self, item: Recognised) -> bool:
        return item.sighting.inliers >= self._settings.sighting.min_inliers

    def _doubtful(self, item: Recognised) -> bool:
        """Whether the picture is known not to fit, and too few key-points agree to outweigh that."""
        misfit = np.nan if item.fit is None else item.fit.misfit
        return bool(misfit > self._settings.misfit) and item.sighting.inliers < self._settings.misfit_inliers

    def _fits(self, item: Recognised) -> bool:
        return item.fits(self._settings.misfit)


def _distinct(verified: Sequence[Recognised], most: int) -> list[Recognised]:
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
