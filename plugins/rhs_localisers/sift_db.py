"""Localiser `sift_db`: odometry, corrected by places it has seen before, held to the walls of the map by the scan.

Between places the belief is dead reckoning with a growing covariance, and every few views the scan is laid onto the map
(rhs.estimation.scans.scan_match): it corrects what it can see, which along a corridor is the side and the heading.
Every few views the place database is asked; its verified answers confirm, correct or replace the guesses
(rhs.estimation.filters.pose_hypotheses). When it abstains nothing changes. A robot that watched its
way, and whom a place would tell less than a bit, asks more seldom, and has no key-points looked for in views that the scan
vouches for; nothing corrects it there, as the errors of scans and places hold each other only where both are heard.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rhs.api.belief import chance_right
from rhs.api.contracts import Context
from rhs.api.geometry import planar
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, Scan, Tracking, View
from rhs.estimation.filters.pose_hypotheses import (
    Hypotheses,
    Hypothesis,
    PlaceFix,
    Trust,
    added,
    begin,
    carried,
    confirms,
    likelier,
    predict,
    silent,
    update,
)
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.survey import at_eye_level
from rhs.estimation.views.explainability import expected
from rhs.estimation.views.features import features, foretell
from rhs.estimation.views.motion_consistency import Continuity
from rhs.estimation.views.place_database import PlaceAnswer, PlaceDatabase, Recognised, shares
from rhs.estimation.views.place_memory import memory_of
from rhs.estimation.views.settings import PlaceSettings, SightingSettings

from .config import SiftDb
from .confirmation import Confirmation, Contradiction, fits, hidden, possible
from .continuity_watch import ContinuityWatch
from .map_spread import MapSpread
from .panorama import LookRound
from .scan_guess import drifted, laid_on_map

NOWHERE = np.diag([100.0] * 3 + [10.0] * 3)  # covariance of an unknown pose, square metres and square radians


class PlaceLocaliser:
    """Keeps a few guesses of the pose and asks the places which is right."""

    def __init__(self, settings: SiftDb, context: Context) -> None:
        self._settings, self._context = settings, context
        a = self._advanced = settings.advanced
        self._trust = Trust(settings.p_true, settings.kidnap_rate, a.gate_probability, a.keep, a.floor)
        self._state: Hypotheses = begin(None, None)
        self._database: PlaceDatabase | None = None
        self._walls: ScanMatcher | None = None  # the map, to judge scans by ...
        self._matcher: ScanMatcher | None = None  # ... and, if that is wished, to correct the belief by
        self._grid: OccupancyGrid | None = None
        self._steps, self._last_asked, self._misfits = 0, 0, 0
        self._of_fix = np.zeros((6, 6))  # what a place lifted on pictures errs by besides what its key-points say ...
        self._of_map = np.zeros((6, 6))  # ... and covariance of a map drawn by one camera, which no fix in it takes away
        self._spread = MapSpread()  # the same of any other map, where its loop closer says so
        self._round: LookRound | None = None  # walls seen all round, by a robot that doubts ...
        self._unhidden = 0  # ... and views since somebody or something stood before them
        self._contradicted = False
        self._before: Hypotheses | None = None  # believed when it was sure last, and moved since
        self._last = np.eye(4)
        self._watching = ContinuityWatch(context.features, None, a.continuity, smooth_share=a.smooth_share)
        self._confirmation, self._contradiction = Confirmation(False, a.confirmation), Contradiction(a.confirmation)

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Store the surveyed views as places."""
        a = self._advanced
        sighting = SightingSettings(self._settings.min_inliers, ratio=self._context.features.ratio, ransac=a.ransac)
        settings = PlaceSettings(self._settings.retrieval, self._settings.checks, sighting, a.places)
        memory = memory_of(views)
        self._database = PlaceDatabase(memory, settings, self._context.rng)
        pictured = any(view.motion.scan_measured for view in views)
        if pictured:
            self._of_fix = flat(a.pictured_sigma_m**2, a.pictured_sigma_rad**2)
            self._of_map = self._of_fix + left_on_loop(views[-1].covariance, a.pictured_share)
        self._spread = MapSpread(() if pictured else views)
        self._fix = self._of_fix + flat(a.places.place_sigma_m**2, np.radians(a.places.place_sigma_deg) ** 2)
        self._grid = None if grid is None else at_eye_level(grid)
        self._walls = ScanMatcher(grid, a.pictured if pictured else a.match) if grid is not None else None
        self._watching = ContinuityWatch(self._context.features, self._walls, a.continuity, smooth_share=a.smooth_share)
        self._matcher = self._walls if self._settings.match_every > 0 else None
        self._round = None if self._walls is None else LookRound(self._grid, self._walls, a.panorama)
        self._areas = max(2.0, 0.5 * len(memory))  # a place is seen from about two stored views

    def start(self, belief: Belief | None) -> None:
        """Begin from a belief, or anywhere."""
        self._steps, self._last_asked, self._misfits, self._contradicted = 0, 0, 0, False
        self._before = None
        self._watching.begin()
        self._unhidden = self._advanced.panorama.about
        if self._round is not None:
            self._round.begin()
        self._contradiction = Contradiction(self._advanced.confirmation)
        self._confirmation = Confirmation(belief is not None and belief.probability > 0.9, self._advanced.confirmation)
        self._spread.begin(None if belief is None else belief.map_from_body)
        if belief is None:
            self._state = begin(None, None)
        else:
            self._last = belief.map_from_body
            self._state = begin(belief.map_from_body, belief.covariance, belief.probability)

    def update(self, observation: Observation, motion: Motion) -> Belief:
        """Predict by the motion, ask the places when it is time, and say how sure this is."""
        s = self._settings
        noise = drifted(motion.covariance, motion.previous_from_body, s.drift_m_per_m, s.drift_rad_per_m,
                        s.advanced.steady_m)
        self._state = predict(self._state, motion.previous_from_body, noise, self._trust)
        predicted = self._state.best
        self._spread.move(motion.previous_from_body)
        self._watch(observation, motion, noise)
        details: dict[str, float] = {}
        scan = observation.scan if observation.scan is not None else motion.scan
        if self._due():
            answer, self._last_asked = self._ask(observation), self._steps
            self._use_places(possible(answer, self._walls, s.advanced.confirmation), observation, scan)
            details = {"place_inliers": _inliers(answer), "place_verified": float(len(answer.verified))}
        if self._matcher is not None and scan is not None and self._steps % s.match_every == 0 and not self._watching.spared:
            self._state = replace(
                self._state, guesses=tuple(laid_on_map(g, scan, self._matcher) for g in self._state.guesses))
        self._look_round(observation.scan, motion)
        self._notice_misfit(observation.scan)
        self._steps += 1
        if not self._spares() or not self._watching.overlaps(observation.camera, motion.previous_from_body):
            foretell(self._context.features, observation.index + 1)
        return self._belief(predicted, details)

    def _watch(self, observation: Observation, motion: Motion, noise: np.ndarray) -> None:
        """Does this view go on from the last one? If not, the robot may have been carried anywhere; until a view goes on
        from the one before the break: then somebody passed close by, and what was known before, moved since, holds."""
        best = self._state.best
        expected = None if best is None else planar(best.map_from_body)
        seen = self._watching.goes_on(observation, motion, expected, sparing=self._spares())
        if seen is not Continuity.GOES_ON and motion.status is Tracking.OK and (
                self._hides(observation.scan, best) or self._watching.on_walls(expected)):
            # the odometry saw past who stands there, or saw what few key-points did not show
            seen = Continuity.UNKNOWN if seen is Continuity.BROKEN else Continuity.GOES_ON
        tracking = best is not None and self._status(best).on_map
        self._confirmation.travel(motion.previous_from_body, seen)
        self._contradiction.move(motion.previous_from_body)
        if tracking:
            self._before = self._state
            self._watching.settle()
            if seen is Continuity.BROKEN:
                self._watching.keep_last()
        elif self._before is not None:
            self._before = predict(self._before, motion.previous_from_body, noise, self._trust)
            if self._watching.resumed(observation.camera):
                self._resume(self._before)
                return
        if seen is Continuity.BROKEN:
            self._carried_off()

    def _look_round(self, scan: Scan | None, motion: Motion) -> None:
        """Walls seen all round may say that nobody was carried off, where nothing is recognised and people are about."""
        best = self._state.best
        if self._round is None:
            return
        self._unhidden += 1
        if best is not None and self._status(best).on_map:
            self._unhidden = 0 if self._hides(scan, best) else self._unhidden
            self._round.begin()
            return
        if not self._round.add(scan, motion.previous_from_body) or self._unhidden >= self._advanced.panorama.about:
            return
        state = added(self._state, self._before, 0.5, self._trust)
        if not any(self._fits(scan, guess) for guess in state.guesses):
            return
        laid, odds = self._round.odds(state.guesses)
        state = replace(state, guesses=tuple(laid))
        sure = likelier(state, odds, self._trust, elsewhere=self._advanced.continuity.carried)
        if sure.best is not None and sure.best.weight >= self._advanced.panorama.sure and self._fits(scan, sure.best):
            self._resume(sure)
        else:
            self._state = likelier(state, odds, self._trust)

    def _notice_misfit(self, scan: Scan | None) -> None:
        """One that may have been carried off unseen, and whose scans lie off the walls view after view, was."""
        best, rules = self._state.best, self._advanced.confirmation
        if best is None or not self._confirmation.confirmed or self._confirmation.held:
            self._misfits = 0
        elif scan is not None and self._walls is not None and (
                np.isfinite(scan.ranges_m).sum() >= self._advanced.continuity.telling_beams):
            off = self._walls.share(scan, planar(best.map_from_body)) < rules.misfit_share
            self._misfits = 0 if not off else self._misfits + (not self._hides(scan, best))
        if self._misfits >= rules.misfits:
            self._confirmation.doubt()
            self._carried_off()

    def _carried_off(self) -> None:
        """It may stand anywhere."""
        self._misfits = 0
        self._state, self._contradicted = carried(self._state, self._advanced.continuity.carried, self._trust), True
        if self._round is not None:
            self._round.again()

    def _resume(self, before: Hypotheses) -> Hypotheses:
        """Nobody was carried off: what was known before the doubt holds."""
        self._state, self._contradicted = before, False
        self._confirmation.resume()
        self._watching.settle()
        return before

    def _holds(self, before: Hypotheses, claim: PlaceFix) -> bool:
        """Whether a doubted robot sees a place named just where it would be, had nobody carried it off."""
        if self._confirmation.confirmed or before.best is None:
            return False
        sharp = chance_right(before.best.covariance) >= self._settings.tracking_above
        return sharp and confirms(before, [claim], self._trust)

    def _use_places(self, places: list[Recognised], observation: Observation, scan: Scan | None) -> None:
        """Named places confirm the belief, speak against it, or put another in its stead."""
        before = self._state
        if not places:
            self._contradicted = self._expects(observation, scan)
            if self._contradicted and self._confirmation.silent():
                self._state = silent(self._state, self._advanced.places.explain.silence, self._trust)
        else:
            weights = shares(places, self._advanced.places)
            claims = [PlaceFix(r.map_from_body, r.covariance + self._of_fix, float(w))
                      for r, w in zip(places, weights, strict=True)]
            strong = places[0].score >= self._advanced.confirmation.strong
            if self._before is not None and strong and self._holds(self._before, claims[0]):
                before = self._resume(self._before)
            self._contradicted = not confirms(self._state, claims, self._trust)
            if not self._accepts(claims, strong, scan):
                return
            trust = self._trust if strong else replace(self._trust, p_true=self._advanced.weak)
            self._state = update(self._state, claims, self._areas, trust)
        if before.best is not None and self._state.best is not None:
            self._confirmation.follow(planar(before.best.map_from_body), planar(self._state.best.map_from_body))
        if self._state.best is None or self._state.best.weight < self._settings.lost_below:
            self._confirmation.divided()

    def _accepts(self, claims: list[PlaceFix], strong: bool, scan: Scan | None) -> bool:
        """Whether the claims may change the belief; what they do to its standing is noted."""
        known = self._confirmation.confirmed
        against = self._contradicted and known
        named = [planar(claim.map_from_body) for claim in claims]
        if against and not strong or not self._contradiction.convinces(named, against=against, held=self._confirmation.held):
            return False
        if self._contradicted and strong:
            self._confirmation.place_named(agrees=False)
            self._confirmation.doubt()
        elif not self._contradicted and (known or (strong and self._fits(scan, self._state.best))):
            self._confirmation.place_named(agrees=True)
        return True

    def _fits(self, scan: Scan | None, guess: Hypothesis | None) -> bool:
        return guess is not None and fits(scan, self._walls, planar(guess.map_from_body), self._advanced.confirmation)

    def _due(self) -> bool:
        return self._doubts() or (self._steps % self._settings.every == 0 and not self._watching.spared)

    def _doubts(self) -> bool:
        sure = 1.0 - self._state.elsewhere >= self._settings.tracking_above
        return not (sure and self._confirmation.confirmed) or self._contradicted

    def _spares(self) -> bool:
        """Whether this view needs no key-points, if its scan vouches for it: a robot that is sure and watched its way has
        asked the places lately, and they would tell it little."""
        if self._doubts() or not self._confirmation.held or self._contradiction.pending:
            return False
        if self._steps % self._settings.every:
            return self._advanced.seldom > 1
        best = self._state.best
        return best is not None and self._steps - self._last_asked < self._advanced.seldom and (
            told_bits(best.covariance, self._fix) < self._advanced.least_bits)

    def _ask(self, observation: Observation) -> PlaceAnswer:
        assert self._database is not None, "learn() comes before update()"
        believed = [guess.map_from_body for guess in self._state.guesses[:3]]
        return self._database.ask(features(observation, self._context.features), observation.camera, believed)

    def _expects(self, observation: Observation, scan: Scan | None) -> bool:
        """Whether the best guess says that this view ought to be recognised, and nobody stands before it."""
        assert self._database is not None, "learn() comes before update()"
        best, seen = self._state.best, features(observation, self._context.features)
        return best is not None and expected(
            self._database.memory, seen, best.map_from_body, self._advanced.places.explain) and not self._hides(scan, best)

    def _hides(self, scan: Scan | None, best: Hypothesis | None) -> bool:
        """Whether somebody stands before what would be seen from the best guess."""
        return best is not None and hidden(
            scan, self._grid, planar(best.map_from_body), self._advanced.confirmation)

    def _belief(self, predicted: Hypothesis | None, details: dict[str, float]) -> Belief:
        """predicted: the best guess before this view was looked at."""
        best = self._state.best
        self._spread.follow(predicted, best)
        if best is None:
            return Belief(self._last, NOWHERE, BeliefStatus.LOST, 0.0, details)
        self._last = best.map_from_body
        standing = self._contradiction.chance(held=self._confirmation.held) * self._confirmation.chance
        covariance = best.covariance + self._of_map + self._spread.covariance
        probability = best.weight * chance_right(covariance) * standing
        details["guesses"] = float(len(self._state.guesses))
        return Belief(best.map_from_body, covariance, self._status(best), probability, details)

    def _status(self, best: Hypothesis) -> BeliefStatus:
        named_elsewhere = self._contradiction.pending >= 2 and not self._confirmation.held
        if best.weight >= self._settings.tracking_above and self._confirmation.confirmed and not named_elsewhere:
            return BeliefStatus.DEGRADED if self._bent(best) else BeliefStatus.TRACKING
        return BeliefStatus.CONVERGING if best.weight >= self._settings.lost_below else BeliefStatus.LOST

    def _bent(self, best: Hypothesis) -> bool:
        """Whether the map is so unsure that the guess, right on it, may lie elsewhere in the building."""
        of_map = self._spread.covariance
        return bool(of_map.any()) and chance_right(best.covariance + of_map) < self._settings.tracking_above


def told_bits(covariance: np.ndarray, fix: np.ndarray) -> float:
    """What a place with covariance `fix` (6, 6), diagonal, tells of a pose on the floor with `covariance` (6, 6), in the
    direction of which it tells most: bits of information, log2(1 + ratio of the variances) / 2."""
    rows = [0, 1, 5]
    s = np.sqrt(np.diag(fix)[rows])
    ratio = np.linalg.eigvalsh(covariance[np.ix_(rows, rows)] / np.outer(s, s))[-1]
    return float(0.5 * np.log2(1.0 + max(ratio, 0.0)))


def left_on_loop(at_end: np.ndarray, share: float) -> np.ndarray:
    """(6, 6) of a map whose loop was closed, from that of the survey's last view before: halfway round half of its deviation
    is left (Brownian bridge)."""
    return flat(share**2 * 0.5 * (at_end[0, 0] + at_end[1, 1]), share**2 * at_end[5, 5])


def flat(place_m2: float, turn_rad2: float) -> np.ndarray:
    """(6, 6) of a pose on the floor, alike in all directions."""
    return np.diag([place_m2, place_m2, 0.0, 0.0, 0.0, turn_rad2])


def _inliers(answer: PlaceAnswer) -> float:
    return float(answer.verified[0].sighting.inliers) if answer.verified else 0.0
