"""What localisers must do (see rhs.testing)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, reduce
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import exp_se3, inverse, log_se3, planar, se2
from rhs.api.records import Belief, BeliefStatus, FeatureSettings, Motion, Observation, Tracking, View
from rhs.api.validate import check_belief

from .odometry import OVERSURE, PLANE
from .room import RATE_HZ, blind, context, drive, empty_grid, for_part
from .shared_state import untouched

Seen = tuple[Observation, Motion]
SIGMA = np.array([0.004, 0.004, 1e-3, 1e-3, 1e-3, 0.004])  # of one motion: metres, radians
FINE = np.diag([1e-3] * 6) ** 2
LOST = Motion(np.eye(4), np.diag([0.1] * 6), Tracking.LOST, "nothing to see")
FOLLOWS_M, FOLLOWS_RAD = 0.05, 0.05  # with nothing but exact motions to go by
RIGHT_M, RIGHT_RAD = 0.3, 0.15  # while it says that it tracks


@cache
def survey(stored: bool = True) -> tuple[View, ...]:
    """The drive as a survey with true poses."""
    return as_survey(drive(), stored=stored)


def as_survey(driven: Sequence[tuple[np.ndarray, Observation]], *, stored: bool = True) -> tuple[View, ...]:
    """Poses (4x4) and what was seen there, as a survey; stored: every second view kept as a place."""
    from rhs.estimation.views.features import features

    views: list[View] = []
    previous = driven[0][0]
    for pose, seen in driven:
        motion = Motion(inverse(previous) @ pose, FINE, Tracking.OK)
        kept = features(seen, FeatureSettings()) if stored and seen.index % 2 == 0 else None
        views.append(freeze(View(seen.index, seen.stamp_s, seen.camera, motion, pose, FINE, seen.scan, kept)))
        previous = pose
    return tuple(views)


@cache
def patrol() -> tuple[Seen, ...]:
    """The drive once more as a patrol: views with other noise, and motions as wrong as their covariance says."""
    rng, out = np.random.default_rng(5), []
    previous = drive()[0][0]
    for pose, seen in drive(seed=1):
        noise = SIGMA * rng.standard_normal(6) * [1, 1, 0, 0, 0, 1] * bool(seen.index)
        out.append((seen, freeze(Motion(inverse(previous) @ pose @ exp_se3(noise), np.diag(SIGMA**2), Tracking.OK))))
        previous = pose
    return tuple(out)


def in_the_dark(motions: Sequence[np.ndarray]) -> list[Seen]:
    """Views with nothing in them, and these motions (4x4): there is nothing else to go by."""
    view = drive()[0][1]
    return [(blind(view, k), freeze(Motion(motion, FINE.copy(), Tracking.OK))) for k, motion in enumerate(motions)]


def hard() -> list[Seen]:
    """The patrol, two blind views with lost motions, the last view twice, and the way back."""
    there = patrol()
    out = list(there)
    still = Motion(np.eye(4), np.diag(SIGMA**2), Tracking.OK)
    out += [(blind(there[0][0], 0), LOST), (blind(there[0][0], 0), LOST), (there[-1][0], still)]
    for (now, _), (_, then) in zip(there[-2::-1], there[:0:-1], strict=True):
        out.append((now, replace(then, previous_from_body=inverse(then.previous_from_body))))
    return [(replace(seen, index=k, stamp_s=k / RATE_HZ), motion) for k, (seen, motion) in enumerate(out)]


def _part(settings: Any, folder: Path, start: Belief | None, *, seed: int = 0, stored: bool = True) -> Any:
    part = complete("localiser", settings.build(context(folder, seed)))
    part.learn(survey(stored), freeze(empty_grid()))
    part.start(start)
    return part


def _start(covariance: np.ndarray = FINE) -> Belief:
    return freeze(Belief(np.array(drive()[0][0]), np.array(covariance)))


def _beliefs(settings: Any, folder: Path, views: Sequence[Seen], start: Belief | None) -> list[Belief]:
    with untouched(views, survey(), start):
        part = _part(settings, folder, start)
        return [check_belief(part.update(for_part(settings, seen), motion), who="update()") for seen, motion in views]


def every_belief_is_one(settings: Any, folder: Path) -> None:
    for start in (_start(), None):
        _beliefs(settings, folder, hard(), start)


def begins_where_it_is_told_and_follows_the_motion(settings: Any, folder: Path) -> None:
    """To the last view: with nothing to see there is nothing else to believe in."""
    pose, motions = drive()[0][0], [np.eye(4), *[se2(0.12, 0.0, 0.08)] * 8, *[se2(0.15, 0.0, -0.02)] * 4]
    truth = reduce(np.matmul, motions, pose)
    said = _beliefs(settings, folder, in_the_dark(motions), _start())[-1].map_from_body
    off, turned = np.linalg.norm(said[:3, 3] - truth[:3, 3]), abs(log_se3(inverse(truth) @ said)[5])
    assert off < FOLLOWS_M and turned < FOLLOWS_RAD, (
        f"from {_words(pose)} the motions lead to {_words(truth)}, it believes {_words(said)}; a belief becomes "
        "map_from_body @ previous_from_body")


def an_error_of_heading_grows_to_the_side(settings: Any, folder: Path) -> None:
    """Two metres straight on, along y of the map, with a heading known to 0.1 rad: 0.2 m to the side, not less than half of
    that."""
    start = freeze(Belief(drive()[0][0] @ se2(0.0, 0.0, np.pi / 2 - 0.2), np.diag([0.02, 0.02, 1e-3, 1e-3, 1e-3, 0.1]) ** 2))
    end = _beliefs(settings, folder, in_the_dark([np.eye(4), *[se2(0.2, 0.0, 0.0)] * 10]), start)[-1]
    ahead, side = np.sqrt(np.diag(end.covariance)[:2])
    fits = "; it is in the map frame, expected the body's" if ahead > 0.1 else ""
    assert side > 0.1, (f"2 m after it was told a heading known to 0.1 rad, the belief is {side:.3f} m wide to the side, "
                        "expected about 0.2 m; begin with the covariance of start(belief) and add covariances with "
                        f"rhs.api.geometry.compose_covariance{fits}")


def is_where_it_says_while_it_tracks(settings: Any, folder: Path) -> None:
    beliefs = _beliefs(settings, folder, patrol(), _start())
    tracked = [(belief, pose) for belief, (pose, _) in zip(beliefs, drive(), strict=True)
               if belief.status is BeliefStatus.TRACKING]
    assert len(tracked) >= len(beliefs) // 2, f"told where it is, it tracks in only {len(tracked)} of {len(beliefs)} views"
    surprise = []
    for belief, pose in tracked:
        error = log_se3(inverse(pose) @ belief.map_from_body)
        assert np.linalg.norm(error[:3]) < RIGHT_M and np.linalg.norm(error[3:]) < RIGHT_RAD, (
            f"says it tracks at {_words(belief.map_from_body)}, truly at {_words(pose)}")
        surprise.append(error[PLANE] @ np.linalg.solve(belief.covariance[np.ix_(PLANE, PLANE)], error[PLANE]) / len(PLANE))
    assert np.mean(surprise) < OVERSURE, f"beliefs are {np.sqrt(np.mean(surprise)):.0f} sigmas wrong in the mean, expected 1"


def starting_from_nothing_is_not_knowing(settings: Any, folder: Path) -> None:
    part = _part(settings, folder, None, stored=False)
    belief = check_belief(part.update(for_part(settings, blind(drive()[0][1], 0)), LOST), who="update()")
    assert belief.status is not BeliefStatus.TRACKING, "no start, no places and nothing to see, yet it claims to track"


def starts_anew_when_told(settings: Any, folder: Path) -> None:
    """A second start leaves nothing of the first."""
    part = _part(settings, folder, Belief(se2(2.0, 1.0, -2.0), FINE))
    for seen, motion in in_the_dark([se2(0.1, 0.0, 0.0)] * 3):
        part.update(for_part(settings, seen), motion)
    part.start(_start())
    seen, motion = in_the_dark([np.eye(4)])[0]
    said, start = part.update(for_part(settings, seen), motion).map_from_body, _start().map_from_body
    off = float(np.linalg.norm(said[:3, 3] - start[:3, 3]))
    assert off < FOLLOWS_M, f"told to start at {_words(start)}, it is at {_words(said)}"


def same_seed_same_beliefs_whoever_else_is_built(settings: Any, folder: Path) -> None:
    alone = _beliefs(settings, folder, hard(), _start())
    part, other = _part(settings, folder, _start()), _part(settings, folder, None, seed=1)
    for k, (seen, motion) in enumerate(hard()):
        if k < 4:
            other.update(for_part(settings, patrol()[-1 - k][0]), LOST)
        again = part.update(for_part(settings, seen), motion).map_from_body
        assert np.array_equal(alone[k].map_from_body, again), "two builds with one seed differ, or share what they know"


def _words(pose: np.ndarray) -> str:
    x, y, yaw = planar(pose)
    return f"({x:.2f}, {y:.2f}) m, {np.degrees(yaw):.0f} degrees"


LOCALISER = (every_belief_is_one, begins_where_it_is_told_and_follows_the_motion, an_error_of_heading_grows_to_the_side,
             is_where_it_says_while_it_tracks, starting_from_nothing_is_not_knowing, starts_anew_when_told,
             same_seed_same_beliefs_whoever_else_is_built)
