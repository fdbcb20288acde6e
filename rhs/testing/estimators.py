"""What odometries, loop closers and localisers must do (see rhs.testing)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.geometry import inverse, se2
from rhs.api.records import Belief, Closure, FeatureSettings, BeliefStatus, Motion, Observation, Tracking, View

from .room import CAMERA, context, empty_grid, observe, paintings, scan_of

DRIVE = [(0.0, 0.0)] + [(0.1, 0.05)] * 7  # metres ahead, radians to the left, per view


@cache
def drive() -> tuple[tuple[np.ndarray, Observation], ...]:
    """A short drive through the room: true poses and what a perfect sensor of every kind reports."""
    textures, pose, out = paintings(), se2(-1.5, -0.5, 0.2), []
    for index, (ahead, left) in enumerate(DRIVE):
        pose = pose @ se2(ahead, 0.0, left)
        seen = observe(CAMERA, pose, textures, index)
        wheel = np.array([ahead, 0.0, left])
        out.append((pose, frozen(replace(seen, scan=scan_of(pose), wheel=wheel))))
    return tuple(out)


def blind(observation: Observation, index: int) -> Observation:
    """The view with nothing in it: a grey image, no depth, no ranges, no wheel."""
    scan = observation.scan
    assert observation.image is not None and scan is not None
    return frozen(replace(
        observation, index=index, stamp_s=0.1 * index, image=np.full_like(observation.image, 128), wheel=None,
        depth=np.full(observation.image.shape[:2], np.nan, np.float32),
        scan=replace(scan, ranges_m=np.full_like(scan.ranges_m, np.nan))))


def frozen(observation: Observation) -> Observation:
    scan = observation.scan
    for array in (observation.image, observation.depth, observation.wheel, scan.ranges_m if scan else None):
        if array is not None:
            array.setflags(write=False)
    return observation


def for_part(settings: Any, observation: Observation) -> Observation:
    """The observation with only what the part asked for."""
    needs = type(settings).needs
    return replace(observation, depth=observation.depth if "depth" in needs else None,
                   scan=observation.scan if "scan" in needs else None,
                   wheel=observation.wheel if "wheel" in needs else None)


def hard_drive() -> list[Observation]:
    """The drive, then nothing to see, one view twice, and the drive back."""
    views = [observation for _, observation in drive()]
    n = len(views)
    again = [replace(view, index=n + 4 + k, stamp_s=0.1 * (n + 4 + k)) for k, view in enumerate(views[::-1])]
    return [*views, blind(views[0], n), blind(views[0], n + 1), replace(views[-1], index=n + 2, stamp_s=0.1 * (n + 2)),
            replace(views[-1], index=n + 3, stamp_s=0.1 * (n + 3)), *again]


def check_pose(pose: np.ndarray, name: str) -> None:
    assert np.shape(pose) == (4, 4), f"{name} has shape {np.shape(pose)}, expected 4x4"
    assert np.all(np.isfinite(pose)), f"{name} is not finite: {pose}"
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6), f"{name} holds no rotation"
    assert np.linalg.det(pose[:3, :3]) > 0, f"{name} is a reflection"


def check_covariance(covariance: np.ndarray) -> None:
    assert np.shape(covariance) == (6, 6), f"covariance has shape {np.shape(covariance)}, expected 6x6"
    assert np.all(np.isfinite(covariance)), "covariance is not finite"
    assert np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-12), "covariance is not symmetric"
    assert np.linalg.eigvalsh(covariance).min() > 0, f"covariance is not positive definite: {np.diag(covariance)}"


def _motions(settings: Any, folder: Path, views: Sequence[Observation]) -> list[Motion]:
    part = settings.build(context(folder))
    return [part.update(for_part(settings, view)) for view in views]


def begins_with_the_identity(settings: Any, folder: Path) -> None:
    first = _motions(settings, folder, hard_drive()[:1])[0]
    assert np.allclose(first.previous_from_body, np.eye(4)), "the first motion must be the identity"
    assert first.status is Tracking.OK, f"the first motion is {first.status}"


def every_motion_is_a_pose_with_an_honest_covariance(settings: Any, folder: Path) -> None:
    for motion in _motions(settings, folder, hard_drive()):
        assert isinstance(motion, Motion), f"update() returned {type(motion).__name__}, expected a Motion"
        assert isinstance(motion.status, Tracking), f"status is {motion.status!r}, expected a Tracking"
        check_pose(motion.previous_from_body, "previous_from_body")
        check_covariance(motion.covariance)


def does_not_trust_a_view_without_content(settings: Any, folder: Path) -> None:
    motion = _motions(settings, folder, hard_drive()[: len(DRIVE) + 1])[-1]
    assert motion.status is not Tracking.OK, "nothing could be seen, yet the motion is ok; say degenerate or lost"
    assert motion.reason, "say in `reason` why the motion is not ok"


def survives_a_blind_start(settings: Any, folder: Path) -> None:
    views = hard_drive()
    start = [replace(blind(views[0], k), index=k) for k in range(2)]
    for motion in _motions(settings, folder, [*start, *views[:4]]):
        check_pose(motion.previous_from_body, "previous_from_body")
        check_covariance(motion.covariance)


def same_seed_same_motions(settings: Any, folder: Path) -> None:
    first, second = (_motions(settings, folder, hard_drive()) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.previous_from_body, b.previous_from_body), "two builds with one seed differ"


def what_it_settles_on_has_as_many_poses_as_views(settings: Any, folder: Path) -> None:
    part = settings.build(context(folder))
    for _, view in drive():
        part.update(for_part(settings, view))
    revision = part.revise()
    if revision is not None:
        assert len(revision.poses) == len(revision.scans) == len(DRIVE)
        for pose in revision.poses:
            check_pose(pose, "a pose of revise()")


ODOMETRY = (begins_with_the_identity, every_motion_is_a_pose_with_an_honest_covariance,
            does_not_trust_a_view_without_content, survives_a_blind_start, same_seed_same_motions,
            what_it_settles_on_has_as_many_poses_as_views)


@cache
def survey(stored: bool = True) -> tuple[View, ...]:
    """The drive as a survey with true poses, every second view kept as a place."""
    from rhs.estimation.views.features import features

    views, previous = [], drive()[0][0]
    for pose, seen in drive():
        motion = Motion(inverse(previous) @ pose, 1e-6 * np.eye(6), Tracking.OK)
        kept = features(seen, FeatureSettings()) if stored and seen.index % 2 == 0 else None
        views.append(View(seen.index, seen.stamp_s, seen.camera, motion, pose, 1e-6 * np.eye(6), seen.scan, kept))
        previous = pose
    return tuple(views)


def returns_a_pose_for_every_view(settings: Any, folder: Path) -> None:
    for views in (survey(), survey()[:1], survey(stored=False)):
        closure = settings.build(context(folder)).close(views)
        assert isinstance(closure, Closure), f"close() returned {type(closure).__name__}, expected a Closure"
        assert np.shape(closure.poses) == (len(views), 4, 4), f"poses have shape {np.shape(closure.poses)}"
        for pose in closure.poses:
            check_pose(pose, "a corrected pose")


def leaves_the_first_pose_alone(settings: Any, folder: Path) -> None:
    closure = settings.build(context(folder)).close(survey())
    assert np.allclose(closure.poses[0], survey()[0].map_from_body, atol=1e-9), "the first pose must not move"


def same_seed_same_closure(settings: Any, folder: Path) -> None:
    first, second = (settings.build(context(folder)).close(survey()).poses for _ in range(2))
    assert np.array_equal(first, second), "two builds with one seed differ"


LOOP_CLOSER = (returns_a_pose_for_every_view, leaves_the_first_pose_alone, same_seed_same_closure)


def _beliefs(settings: Any, folder: Path, *, known_start: bool) -> list[Belief]:
    part = settings.build(context(folder))
    part.learn(survey(), empty_grid())
    part.start(Belief(drive()[0][0], 1e-4 * np.eye(6)) if known_start else None)
    step = Motion(se2(0.1, 0.0, 0.05), 1e-4 * np.eye(6), Tracking.OK)
    lost = Motion(np.eye(4), np.eye(6), Tracking.LOST, "nothing to see")
    return [part.update(for_part(settings, view), step if np.isfinite(view.depth).any() else lost)  # type: ignore[arg-type]
            for view in hard_drive()]


def every_belief_is_a_pose_with_an_honest_covariance(settings: Any, folder: Path) -> None:
    for known_start in (True, False):
        for belief in _beliefs(settings, folder, known_start=known_start):
            assert isinstance(belief, Belief), f"update() returned {type(belief).__name__}, expected a Belief"
            assert isinstance(belief.status, BeliefStatus), f"status is {belief.status!r}, expected a BeliefStatus"
            assert 0.0 <= belief.probability <= 1.0, f"probability is {belief.probability}"
            check_pose(belief.map_from_body, "map_from_body")
            check_covariance(belief.covariance)


def starting_from_nothing_is_not_knowing(settings: Any, folder: Path) -> None:
    part = settings.build(context(folder))
    part.learn(survey(stored=False), empty_grid())
    part.start(None)
    belief = part.update(for_part(settings, blind(drive()[0][1], 0)), Motion(np.eye(4), np.eye(6), Tracking.LOST))
    assert belief.status is not BeliefStatus.TRACKING, "no start, no places and nothing to see, yet it claims to track"


def same_seed_same_beliefs(settings: Any, folder: Path) -> None:
    first, second = (_beliefs(settings, folder, known_start=True) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.map_from_body, b.map_from_body), "two builds with one seed differ"


LOCALISER = (every_belief_is_a_pose_with_an_honest_covariance, starting_from_nothing_is_not_knowing,
             same_seed_same_beliefs)
