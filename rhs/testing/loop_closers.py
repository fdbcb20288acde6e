"""What loop closers must do (see rhs.testing)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import compose_covariance, inverse, log_se3, se2
from rhs.api.records import Closure, FeatureSettings, Motion, Tracking, View
from rhs.api.validate import check_closure

from .room import CAMERA, context, observe, paintings, scan_of
from .shared_state import untouched

COUNT, RADIUS_M = 24, 1.5
SIGMA = np.array([0.01, 0.01, 1e-3, 1e-3, 1e-3, 0.01])  # of one motion: metres, radians
DRIFT = (0.008, -0.004, 0.006)  # what each motion is wrong by all along: x m, y m, yaw rad
WORSE, SLACK_M = 1.1, 0.02  # poses may not get worse by more than this
AWAY = se2(3.0, -1.0, 2.0)  # the same survey in another frame
EDGE_M, EDGE_RAD = 0.3, 0.15  # an accepted edge is not further from the truth than that


@cache
def ring() -> tuple[np.ndarray, ...]:
    """True poses once round a circle to the left, not about the middle of the room; the last is where the first was."""
    angles = np.linspace(0.0, 2.0 * np.pi, COUNT + 1)
    return tuple(se2(0.5 + RADIUS_M * np.cos(a), 0.2 + RADIUS_M * np.sin(a), a + np.pi / 2) for a in angles)


@cache
def survey(*, drifting: bool = True, stored: bool = True) -> tuple[View, ...]:
    """The ring as a survey: views at true poses, believed to be where motions that drift lead; sealed."""
    from rhs.estimation.views.features import features

    rng, drift = np.random.default_rng(1), se2(*DRIFT)
    views: list[View] = []
    believed, spread = ring()[0], 1e-9 * np.eye(6)
    for index, true in enumerate(ring()):
        step = np.eye(4)
        if index:
            wrong = drift @ se2(*(0.002 * rng.standard_normal(3))) if drifting else np.eye(4)
            step = inverse(ring()[index - 1]) @ true @ wrong
            believed, spread = believed @ step, compose_covariance(spread, step, np.diag(SIGMA**2))
        seen = observe(CAMERA, true, paintings(), index)
        kept = features(seen, FeatureSettings()) if stored else None
        motion = Motion(step, np.diag(SIGMA**2), Tracking.OK)
        views.append(freeze(View(index, seen.stamp_s, CAMERA, motion, believed, spread, scan_of(true), kept)))
    return tuple(views)


def _close(settings: Any, folder: Path, views: tuple[View, ...]) -> Closure:
    part = complete("loop_closer", settings.build(context(folder)))
    with untouched(views):
        return check_closure(part.close(views), views, who="close()")


def error_m(poses: np.ndarray) -> float:
    """Root mean square distance of poses (N, 4, 4) from the ring; both begin at one place."""
    truth = np.array([pose[:3, 3] for pose in ring()])
    return float(np.sqrt(np.mean(np.sum((poses[:, :3, 3] - truth) ** 2, axis=1))))


def returns_a_pose_for_every_view_and_leaves_the_first(settings: Any, folder: Path) -> None:
    for views in (survey(drifting=False)[:1], survey(stored=False)):
        _close(settings, folder, views)


def does_not_make_the_survey_worse(settings: Any, folder: Path) -> None:
    for drifting in (True, False):
        views = survey(drifting=drifting)
        before = error_m(np.array([view.map_from_body for view in views]))
        after = error_m(_close(settings, folder, views).poses)
        assert after <= WORSE * before + SLACK_M, (
            f"poses {'that drift' if drifting else 'without error'} were {before:.3f} m wrong and are {after:.3f} m wrong")


def accepts_loops_that_are_true(settings: Any, folder: Path) -> None:
    for edge in _close(settings, folder, survey()).edges:
        true = inverse(ring()[edge.earlier]) @ ring()[edge.later]
        off = log_se3(inverse(true) @ edge.earlier_from_later)
        far, turned = np.linalg.norm(off[:3]), np.linalg.norm(off[3:])
        assert not edge.accepted or (far < EDGE_M and turned < EDGE_RAD), (
            f"accepts view {edge.later} seen from view {edge.earlier} {far:.2f} m and {np.degrees(turned):.0f} degrees off; "
            "edges are earlier_from_later in body frames")


def same_seed_same_closure_and_no_memory(settings: Any, folder: Path) -> None:
    first = _close(settings, folder, survey())
    elsewhere = tuple(replace(view, map_from_body=AWAY @ view.map_from_body) for view in survey())
    moved = inverse(AWAY) @ _close(settings, folder, elsewhere).poses
    assert error_m(moved) <= WORSE * error_m(first.poses) + SLACK_M, (
        f"a survey that began elsewhere ends {error_m(moved):.3f} m wrong instead of {error_m(first.poses):.3f} m")
    assert np.array_equal(first.poses, _close(settings, folder, survey()).poses), "two builds with one seed differ"


LOOP_CLOSER = (returns_a_pose_for_every_view_and_leaves_the_first, does_not_make_the_survey_worse,
               accepts_loops_that_are_true, same_seed_same_closure_and_no_memory)
