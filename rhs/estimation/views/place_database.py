"""The place database: stored views with their key-points and poses, asked "where was this seen?" (thesis section 5.2).

An answer is a pose in the map with covariance, or `abstained` with a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.geometry import Camera, compose_covariance, inverse, planar, wrap
from rhs.api.records import Features

from .explainability import explainability, nearest_views
from .place_memory import Memory, Rootsift
from .retrieval import make_retrieval
from .settings import PlaceRules, PlaceSettings, SightingSettings
from .thumbnails import Blocks, ThumbnailFit, blocks, fit, outdoes
from .view_pose import Sighting, Snapshot, sight

USUAL = PlaceRules()


@dataclass(frozen=True, eq=False)
class Recognised:
    """One verified candidate: the stored place, how it was seen, the pose in the map that follows, how much of the view
    the memory explains from there (NaN for a weaker candidate of the same place), and how the picture fits, where known."""

    place: int
    sighting: Sighting
    map_from_body: np.ndarray
    covariance: np.ndarray
    score: float = np.nan
    fit: ThumbnailFit | None = None

    def fits(self, limit: float) -> bool:
        """Whether the picture is known to look as it must from here; never true of one that cannot be compared."""
        return self.fit is not None and self.fit.misfit <= limit


@dataclass(frozen=True, eq=False)
class PlaceAnswer:
    """best: the place recognised, or None when abstained, for `reason`. verified: the best candidate of each different place
    that passed the check, most inliers first. distinct: those of them that the picture does not refute, best explained
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
        self.memory, self._settings, self._rules, self._rng = memory, settings, settings.rules, rng
        usable = len(memory) > 0 and len(memory.descriptors) > 0
        self.retrieval = (
            make_retrieval(settings.retrieval, Rootsift(memory.descriptors), memory.starts, rng) if usable else None
        )

    def ask(self, query: Features, camera: Camera, also: Sequence[np.ndarray] = ()) -> PlaceAnswer:
        """Where was this seen? Retrieve, check by geometry, weigh by how much the memory explains; abstain when nothing
        or too much fits.

        also: poses (4x4) believed in, whose nearest stored view is checked as well. Without this a belief would be
        contradicted by answers that never looked at it.
        """
        if self.retrieval is None or len(query.pixels) < 2:
            return _abstained("nothing stored" if self.retrieval is None else "no key-points in the view")
        ranked, scores = self.retrieval.rank(query.descriptors, 4 * max(self._settings.checks, self._rules.faint_checks))
        believed = [int(view) for pose in also for view in nearest_views(self.memory, pose, 1, self._rules.explain)]
        view = _Asked(Snapshot(query, camera), blocks(query.thumbnail, camera))
        likely = self._likely([*self._spread(ranked, self._settings.checks), *believed], view, self._settings.sighting)
        comparable = view.blocks is not None and self.memory.greys.size > 0
        if self._rules.faint_checks > 0 and comparable and not any(map(self._fits, likely)):
            faint = replace(self._settings.sighting, min_inliers=self._rules.faint_inliers)
            more = self._likely([*self._spread(ranked, self._rules.faint_checks), *believed], view, faint)
            enough = self._settings.sighting.min_inliers
            likely = [item for item in more if item.sighting.inliers >= enough or self._fits(item)]
        return self._judged(likely, ranked, scores)

    def _spread(self, ranked: np.ndarray, most: int) -> list[int]:
        """The best candidates, no more than two of them from one neighbourhood: look-alikes get a hearing."""
        chosen: list[int] = []
        for place in ranked:
            same = sum(not apart(self.memory.poses[place], self.memory.poses[other], self._rules) for other in chosen)
            if same < 2:
                chosen.append(int(place))
            if len(chosen) == most:
                break
        return chosen

    def _likely(self, places: Sequence[int], view: _Asked, sighting: SightingSettings) -> list[Recognised]:
        """Different places among candidates that enough key-points agree on, with score and fit; most inliers first."""
        found = [self._check(place, view.snapshot, sighting) for place in dict.fromkeys(places)]
        passed = sorted((item for item in found if item is not None), key=lambda r: -r.sighting.inliers)
        looked = [self._looked(item, view) for item in _distinct(passed, self._rules)]
        return [item for item in looked if item.score >= self._rules.min_score]

    def _check(self, place: int, query: Snapshot, sighting: SightingSettings) -> Recognised | None:
        stored = Snapshot(self.memory.features(place), self.memory.camera)
        seen = sight(stored, query, settings=sighting, rng=self._rng)
        if seen is None:
            return None
        covariance = compose_covariance(_place_covariance(self._rules), seen.stored_from_query, seen.covariance)
        return Recognised(place, seen, self.memory.poses[place] @ seen.stored_from_query, covariance)

    def _judged(self, likely: Sequence[Recognised], ranked: np.ndarray, scores: np.ndarray) -> PlaceAnswer:
        fitting = [item for item in likely if self._fits(item)]
        left = [r for r in likely if not any(outdoes(other.fit, r.fit) > self._rules.level for other in fitting)]
        distinct = tuple(sorted(left, key=lambda r: -r.score))
        best, reason = None, ""
        if not distinct:
            reason = "no candidate passed the geometric check"
        elif any(rival.score > self._rules.rival_share * distinct[0].score for rival in distinct[1:]):
            reason = "two places look alike"
        elif self._doubtful(distinct[0]):
            reason = "the picture does not look like the place"
        else:
            best = distinct[0]
        return PlaceAnswer(best, reason, tuple(likely), distinct, ranked, scores)

    def _looked(self, item: Recognised, view: _Asked) -> Recognised:
        """The candidate with its score (explainability) and with how the picture fits there."""
        seen, rules = view.snapshot, self._rules
        score = explainability(self.memory, seen.features, seen.camera, item.map_from_body, settings=rules.explain).score
        return replace(item, score=score, fit=fit(self.memory, view.blocks, item.map_from_body, rules.thumbnails))

    def _doubtful(self, item: Recognised) -> bool:
        """Whether the picture is known not to fit, and too few key-points agree to outweigh that."""
        misfit = np.nan if item.fit is None else item.fit.misfit
        return bool(misfit > self._rules.misfit) and item.sighting.inliers < self._rules.misfit_inliers

    def _fits(self, item: Recognised) -> bool:
        return item.fits(self._rules.misfit)


def _distinct(verified: Sequence[Recognised], rules: PlaceRules) -> list[Recognised]:
    """The verified candidate with most inliers of each different place, at most `most` of them."""
    out: list[Recognised] = []
    for item in verified:
        if all(apart(item.map_from_body, other.map_from_body, rules) for other in out):
            out.append(item)
    return out[: rules.most]


def shares(distinct: Sequence[Recognised], rules: PlaceRules = USUAL) -> np.ndarray:
    """(D,) how the evidence is divided between distinct places; adds up to one.

    Places within `tie` of the best score count as equal: such differences come from where the stored views happen to
    stand and keep their sign for many views, so they must not be counted view after view. Below, e-fold per 1 / slope.
    """
    scores = np.array([item.score for item in distinct])
    if len(scores) == 0:
        return scores
    likely = np.exp(-rules.slope * np.maximum(1.0 - scores / scores.max() - rules.tie, 0.0))
    shares: np.ndarray = likely / likely.sum()
    return shares


def apart(pose_a: np.ndarray, pose_b: np.ndarray, rules: PlaceRules = USUAL) -> bool:
    """Whether two poses (4x4) are different places rather than two estimates of one."""
    x_m, y_m, yaw_rad = planar(inverse(pose_a) @ pose_b)
    return bool(np.hypot(x_m, y_m) > rules.apart_m or abs(wrap(yaw_rad)) > np.radians(rules.apart_deg))


def _place_covariance(rules: PlaceRules) -> np.ndarray:
    return np.diag([rules.place_sigma_m**2] * 3 + [np.radians(rules.place_sigma_deg) ** 2] * 3)


def _abstained(reason: str) -> PlaceAnswer:
    return PlaceAnswer(None, reason, (), (), np.empty(0, int), np.empty(0))
