"""A robot that knows its place does not look for key-points, nor ask the places, in every view; any doubt ends that."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import FEATURES, SMALL, context, look, ring, survey

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, planar, se2
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.api.records import Belief, BeliefStatus, Features, Motion, Observation, Scan, Tracking
from rhs.estimation.scans.rays import cast
from rhs.estimation.views import features as vision
from rhs.estimation.views.motion_consistency import Continuity
from rhs_localisers.advanced import SiftDbAdvanced
from rhs_localisers.config import SiftDb
from rhs_localisers.continuity_watch import ContinuityWatch
from rhs_localisers.sift_db import flat, told_bits

BEARINGS = np.linspace(-0.45, 0.45, 41)
SURE = np.diag([1e-5] * 3 + [1e-6] * 3)


def _room():
    """6 m by 4 m with a pillar, so that a scan tells where it was taken."""
    shape, origin_m = frame_of((-3.5, -2.5, 3.5, 2.5), 0.05)
    grid = OccupancyGrid(np.full(shape, 0.02, np.float32), 0.05, origin_m)
    probability = grid.probability.copy()
    x, y = np.moveaxis(grid.centres(np.argwhere(np.ones(shape, bool))).reshape(*shape, 2), 2, 0)
    probability[(np.abs(x) > 3.0) | (np.abs(y) > 2.0) | (np.hypot(x, y) < 0.3)] = 0.98
    return replace(grid, probability=probability)


def _scan(pose, grid):
    x, y, yaw = planar(pose)
    return Scan(BEARINGS, cast(grid.occupied(), grid, np.array([x, y]), BEARINGS + yaw, 8.0), 8.0)


def _seen(pose, grid, index=0):
    return replace(look(pose), index=index, scan=_scan(pose, grid))


def _looked_for(view):
    return FEATURES in vision._shared.get(view, {})


def _on(poses):
    return [np.eye(4), *(inverse(a) @ b for a, b in zip(poses[:-1], poses[1:], strict=True))]


@pytest.fixture
def part():
    grid = _room()
    made = SiftDb(match_every=0).build(context())
    made.learn(survey(ring(24)), grid)
    made.start(Belief(ring(48)[0], SURE))
    return made, grid


def _drive(part, poses, grid, status=Tracking.OK):
    views, beliefs = [_seen(pose, grid, k) for k, pose in enumerate(poses)], []
    for view, step in zip(views, _on(poses), strict=True):
        beliefs.append(part.update(view, Motion(step, SURE, status)))
    return [_looked_for(view) for view in views], beliefs


def test_views_that_the_scan_vouches_for_need_no_key_points(part):
    looked, beliefs = _drive(part[0], ring(90)[:12], part[1])
    assert sum(looked) <= 6 and looked[0]
    asked = [belief.details.get("place_verified") is not None for belief in beliefs]
    assert [k for k in range(12) if asked[k]] == [0, 9]
    assert all(belief.status is BeliefStatus.TRACKING for belief in beliefs)


def test_where_the_odometry_lost_its_way_every_view_is_looked_at(part):
    assert all(_drive(part[0], ring(90)[:6], part[1], Tracking.DEGENERATE)[0])


def test_one_carried_off_where_the_scan_does_not_go_on_is_looked_at_at_once(part):
    made, grid = part
    assert not all(_drive(made, ring(90)[:5], grid)[0])
    away = _seen(se2(-1.0, 1.2, 2.0), grid, 5)
    made.update(away, Motion(np.eye(4), SURE, Tracking.OK))
    assert _looked_for(away)


def test_one_carried_off_to_where_the_scan_is_the_same_hears_of_it_within_nine_views(part):
    """The room looks the same to a laser from the other side, turned round; the paintings do not."""
    made, grid = part
    poses = ring(90)[:20]
    there = [se2(0.0, 0.0, np.pi) @ pose for pose in poses]
    _drive(made, poses[:5], grid)
    steps, chances = _on(poses), []
    for k in range(5, 14):
        view = replace(_seen(there[k], grid, k), scan=_scan(poses[k], grid))
        chances.append(made.update(view, Motion(steps[k], SURE, Tracking.OK)).probability)
    assert chances[0] > 0.99 and chances[-1] < 0.97, "places named elsewhere speak against it"


@pytest.mark.parametrize(("there", "status"), [
    (se2(-1.5, -1.2, 2.5), BeliefStatus.LOST), (ring(90)[4], BeliefStatus.TRACKING)])
def test_one_carried_off_while_nothing_was_seen_hears_of_it_from_scans_that_lie_off_the_walls(part, there, status):
    """One view shows neither key-points nor a scan; later ones no key-points, and a scan from elsewhere or from there."""
    made, grid = part
    _drive(made, ring(90)[:5], grid)
    beliefs = []
    for k in range(5, 16):
        view = replace(_seen(there, grid, k), scan=None if k == 5 else _scan(there, grid))
        vision.share(view, FEATURES, Features(np.empty((0, 2)), np.empty((0, 128)), np.empty((0, 3))))
        beliefs.append(made.update(view, Motion(np.eye(4), SURE, Tracking.LOST)).status)
    assert beliefs[0] is BeliefStatus.TRACKING and beliefs[-1] is status


def test_a_picture_that_stands_while_the_robot_goes_vouches_for_nothing():
    grid = _room()
    from rhs.estimation.scans.scan_match import ScanMatcher

    poses = ring(90)[:3]
    for stands, looked in ((False, False), (True, True)):
        watch = ContinuityWatch(FEATURES, ScanMatcher(grid))
        for k, (pose, step) in enumerate(zip(poses, _on(poses), strict=True)):
            view = _seen(pose, grid, k)
            view = replace(view, image=_seen(poses[min(k, 1)], grid).image) if stands else view
            seen = watch.goes_on(view, Motion(step, SURE, Tracking.OK), planar(pose), sparing=k > 0)
        assert _looked_for(view) == looked
        assert looked or seen is Continuity.GOES_ON


def test_key_points_are_compared_before_half_of_them_has_left_the_view():
    grid = _room()
    from rhs.estimation.scans.scan_match import ScanMatcher

    watch, begin = ContinuityWatch(FEATURES, ScanMatcher(grid)), ring(90)[0]
    poses = [begin @ se2(0.0, 0.0, 0.12 * k) for k in range(8)]
    looked = []
    for k, (pose, step) in enumerate(zip(poses, _on(poses), strict=True)):
        view = _seen(pose, grid, k)
        watch.goes_on(view, Motion(step, SURE, Tracking.OK), planar(pose), sparing=True)
        looked.append(_looked_for(view))
    assert looked[0] and 1 <= sum(looked[1:]) <= 4


def test_what_a_place_tells_in_bits():
    fix = flat(0.03**2, 0.01**2)
    assert told_bits(np.zeros((6, 6)), fix) == 0.0
    assert told_bits(3.0 * fix, fix) == pytest.approx(1.0)
    assert told_bits(np.diag([0.0] * 5 + [15.0]) * 0.01**2, fix) == pytest.approx(2.0)


def test_a_view_whose_key_points_are_foretold_has_them_found_ahead():
    from rhs.api.spare import grant

    pose = ring(90)[3]
    views = [replace(look(pose), index=k) for k in (40, 41, 42)]
    grant(True)
    try:
        vision.foretell(FEATURES, 41)
        for view in views:
            vision.foresee(view)
        assert [_looked_for(view) for view in views] == [False, True, False]
    finally:
        grant(False)


@pytest.mark.parametrize("wrong", [{"seldom": 0}, {"least_bits": -1.0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError):
        SiftDbAdvanced(**wrong)


def test_a_view_without_a_scan_is_looked_at_as_before():
    made = SiftDb(match_every=0).build(context())
    made.learn(survey(ring(24)), None)
    made.start(Belief(ring(48)[0], SMALL))
    poses = ring(90)[:6]
    views = [replace(look(pose), index=k) for k, pose in enumerate(poses)]
    for view, step in zip(views, _on(poses), strict=True):
        made.update(view, Motion(step, SURE, Tracking.OK))
    assert all(_looked_for(view) for view in views) and isinstance(views[0], Observation)
