"""What odometries must do (see rhs.testing)."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.geometry import inverse, log_se3, planar, se2, se3
from rhs.api.records import Motion, Observation, Tracking
from rhs.api.validate import check_motion, check_revision

from .room import CAMERA, CORRIDOR, FURNISHED, HALL, RATE_HZ, SHORT, TUBE, Room, blind, context, drive, for_part
from .shared_state import untouched

ROOMS = (HALL, FURNISHED, CORRIDOR, TUBE)
WRONG_SHARE = 1.0 / 3.0  # of the way, and of the turn: what is inverted, mirrored or in another unit is further off
OVERSURE = 100.0  # mean normalised squared error per dimension: sigmas ten times too small
UNSURE_M, UNSURE_RAD = 0.5, 0.5  # sigmas of a motion of 0.1 m that cannot be called ok
PLANE = [0, 1, 5]


def hard_drive() -> list[Observation]:
    """A short drive, then nothing to see, one view twice, and the drive back."""
    views = [observation for _, observation in drive(HALL, SHORT)]
    n = len(views)
    later = [*views[-1:], *views[-1:], *views[::-1]]
    again = [replace(view, index=n + 2 + k, stamp_s=(n + 2 + k) / RATE_HZ) for k, view in enumerate(later)]
    return [*views, blind(views[0], n), blind(views[0], n + 1), *again]


def _build(settings: Any, folder: Path, *, seed: int = 0, room: Room = HALL) -> Any:
    return complete("odometry", settings.build(context(folder, seed, room)))


def _motions(settings: Any, folder: Path, views: Sequence[Observation], room: Room = HALL) -> list[Motion]:
    part, seen = _build(settings, folder, room=room), [for_part(settings, view) for view in views]
    with untouched(seen):
        return [check_motion(part.update(view), who="update()") for view in seen]


def begins_with_the_identity(settings: Any, folder: Path) -> None:
    first = _motions(settings, folder, hard_drive()[:1])[0]
    assert np.allclose(first.previous_from_body, np.eye(4)), "the first motion must be the identity"
    assert first.status is Tracking.OK, f"the first motion is {first.status}"


def says_where_the_robot_went_and_how_sure_it_is(settings: Any, folder: Path) -> None:
    """In one of four rooms at least: not everybody is made for all of them."""
    wrong = []
    for room in ROOMS:
        truth = [pose for pose, _ in drive(room)]
        what = _wrong(_motions(settings, folder, [view for _, view in drive(room)], room), truth)
        if not what:
            return
        wrong.append(f"in the {room.name} {what}")
    raise AssertionError("; ".join(wrong))


def _wrong(motions: list[Motion], truth: list[np.ndarray]) -> str:
    """What is wrong with these motions, or nothing."""
    sure = [k for k in range(1, len(truth)) if motions[k].status is Tracking.OK]
    if len(sure) < len(truth) // 2:
        return f"only {len(sure)} of {len(truth) - 1} motions are ok"
    said = reduce(np.matmul, [motion.previous_from_body for motion in motions])
    true = inverse(truth[0]) @ truth[-1]
    if _misses(said, true):
        fits = [f"; it would fit if {name}" for name, other in _mistaken(motions).items() if not _misses(other, true)]
        return f"the way ends at {_words(said)}, truly at {_words(true)}{(fits or [''])[0]}"
    errors = [log_se3(inverse(inverse(truth[k - 1]) @ truth[k]) @ motions[k].previous_from_body)[PLANE] for k in sure]
    spread = [motions[k].covariance[np.ix_(PLANE, PLANE)] for k in sure]
    surprise = float(np.mean([e @ np.linalg.solve(c, e) / len(PLANE) for e, c in zip(errors, spread, strict=True)]))
    if surprise > OVERSURE:
        return (f"errors are {np.sqrt(surprise):.0f} sigmas of the covariance in the mean, "
                f"expected about 1 and at most {np.sqrt(OVERSURE):.0f}")
    sigma = np.sqrt(np.median([np.diag(c) for c in spread], axis=0))
    if sigma[:2].max() > UNSURE_M or sigma[2] > UNSURE_RAD:
        return f"motions are ok with sigmas of {sigma[:2].max():.2g} m and {sigma[2]:.2g} rad; say degenerate"
    return ""


def _misses(said: np.ndarray, true: np.ndarray) -> bool:
    (*_, turn), (*_, turned) = planar(said), planar(true)
    way = float(np.linalg.norm(true[:3, 3]))
    return (float(np.linalg.norm(said[:3, 3] - true[:3, 3])) > WRONG_SHARE * way
            or abs(turn - turned) > max(WRONG_SHARE * abs(turned), 0.02)
            or float(np.abs(said[:3, :3] - true[:3, :3]).max()) > 0.2)


def _mistaken(motions: Sequence[Motion]) -> dict[str, np.ndarray]:
    """The way as it would be without a common mistake in each motion."""
    flip, camera = np.diag([1.0, -1.0, 1.0, 1.0]), CAMERA.body_from_camera
    steps = [motion.previous_from_body for motion in motions]
    mended: dict[str, list[np.ndarray]] = {
        "it were inverted": [inverse(step) for step in steps],
        "left and right were exchanged": [flip @ step @ flip for step in steps],
        "it were in centimetres": [se3(step[:3, :3], step[:3, 3] / 100.0) for step in steps],
        "it were in millimetres": [se3(step[:3, :3], step[:3, 3] / 1000.0) for step in steps],
        "its angle, in degrees, were in radians": [se2(x, y, np.radians(yaw)) for x, y, yaw in map(planar, steps)],
        "it were the body's, not the camera's: body_from_camera @ motion @ camera_from_body": [
            camera @ step @ inverse(camera) for step in steps],
        "it were not summed up since the start": steps[-1:]}
    return {name: reduce(np.matmul, each) for name, each in mended.items()}


def _words(pose: np.ndarray) -> str:
    x, y, yaw = planar(pose)
    return f"({x:.3g}, {y:.3g}) m, {np.degrees(yaw):.3g} degrees"


def does_not_trust_a_view_without_content(settings: Any, folder: Path) -> None:
    motion = _motions(settings, folder, hard_drive()[: len(SHORT) + 1])[-1]
    assert motion.status is not Tracking.OK, "nothing could be seen, yet the motion is ok; say degenerate or lost"
    assert motion.reason, "say in `reason` why the motion is not ok"


def survives_a_blind_start(settings: Any, folder: Path) -> None:
    views = hard_drive()
    _motions(settings, folder, [blind(views[0], 0), blind(views[0], 1), *views[2:5]])


def same_seed_same_motions_whoever_else_is_built(settings: Any, folder: Path) -> None:
    """Through blind views and the way back, too."""
    views = [for_part(settings, view) for view in hard_drive()]
    alone = _motions(settings, folder, views)
    part, other = _build(settings, folder), _build(settings, folder, seed=1)
    for k, (view, motion) in enumerate(zip(views, alone, strict=True)):
        if k < len(views) // 2:
            other.update(views[-1 - k])
        again = part.update(view).previous_from_body
        assert np.array_equal(motion.previous_from_body, again), "two builds with one seed differ, or share what they know"


def what_it_settles_on_has_as_many_poses_as_views(settings: Any, folder: Path) -> None:
    part = _build(settings, folder)
    for _, view in drive(HALL, SHORT):
        part.update(for_part(settings, view))
    if (revision := part.revise()) is not None:
        check_revision(revision, len(SHORT), who="revise()")


def goes_on_the_same_in_another_process(settings: Any, folder: Path) -> None:
    """Pickled half-way, as a survey that is kept for later sweeps; or it cannot be pickled."""
    views = [for_part(settings, view) for view in hard_drive()]
    half = len(views) // 2
    part = _build(settings, folder)
    for view in views[:half]:
        part.update(view)
    try:
        pickled = pickle.dumps(part)
    except Exception:
        return
    other = pickle.loads(pickled)  # noqa: S301 (written above)
    for view in views[half:]:
        motion, again = part.update(view), other.update(view)
        assert np.array_equal(motion.previous_from_body, again.previous_from_body), (
            "pickled half-way it goes on otherwise; keep all that it knows, or raise TypeError in __getstate__")


ODOMETRY = (begins_with_the_identity, says_where_the_robot_went_and_how_sure_it_is, does_not_trust_a_view_without_content,
            survives_a_blind_start, same_seed_same_motions_whoever_else_is_built,
            what_it_settles_on_has_as_many_poses_as_views, goes_on_the_same_in_another_process)
