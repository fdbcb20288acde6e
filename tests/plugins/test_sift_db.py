"""The localiser sift_db: drift is taken out, a lost robot finds itself, look-alike places stay undecided."""

import numpy as np
import pytest
from painted_survey import SMALL, context, look, ring, survey

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, log_se3, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, Scan, Tracking
from rhs.api.settings import make
from rhs.estimation.filters.pose_hypotheses import PlaceFix, Trust, begin, predict, update
from rhs.estimation.scans.rays import cast
from rhs_localisers.config import SiftDb


def _learnt(**settings):
    part = SiftDb(**settings).build(context())
    part.learn(survey(ring(24)), None)
    return part


def _walk(part, truth, believed_motion):
    beliefs = []
    for k, pose in enumerate(truth):
        step = np.eye(4) if k == 0 else believed_motion(inverse(truth[k - 1]) @ pose)
        beliefs.append(part.update(look(pose), Motion(step, SMALL, Tracking.OK)))
    return beliefs


def _wrong_m(belief, truth):
    return float(np.linalg.norm(log_se3(inverse(truth) @ belief.map_from_body)[:3]))


PATH = [se2(1.4 * np.cos(a), 1.4 * np.sin(a), a + 1.5) for a in np.linspace(0.1, 1.4, 8)]


def test_drift_that_dead_reckoning_keeps_is_taken_out():
    part = _learnt(every=2)
    part.start(Belief(PATH[0], SMALL))
    beliefs = _walk(part, PATH, lambda step: step @ se2(0.01, 0.0, 0.004))  # 5 % too far, and turning
    assert _wrong_m(beliefs[-1], PATH[-1]) < 0.05
    assert beliefs[-1].status is BeliefStatus.TRACKING


def test_started_from_nothing_it_says_lost_then_finds_itself():
    part = _learnt()
    part.start(None)
    beliefs = _walk(part, PATH, lambda step: step)
    assert beliefs[1].status is not BeliefStatus.TRACKING  # one place named is not enough
    assert beliefs[-1].status is BeliefStatus.TRACKING and beliefs[-1].probability > 0.9
    assert _wrong_m(beliefs[-1], PATH[-1]) < 0.05


def test_carried_away_it_recovers():
    part = _learnt(every=1)
    part.start(Belief(PATH[0], SMALL))
    _walk(part, PATH[:3], lambda step: step)
    elsewhere = [se2(-1.4 * np.cos(a), -1.4 * np.sin(a), a - 1.6) for a in np.linspace(0.1, 1.5, 11)]
    beliefs = _walk(part, elsewhere, lambda step: step)
    assert _wrong_m(beliefs[-1], elsewhere[-1]) < 0.05
    assert beliefs[-1].status is BeliefStatus.TRACKING


def test_somebody_who_fills_the_view_for_a_while_makes_nobody_lost_for_longer_than_that():
    part, here, another = _learnt(every=1), look(PATH[0]), look(se2(-1.4, 0.0, 4.6))
    part.start(Belief(PATH[0], SMALL))
    told = [part.update(view, Motion(np.eye(4), SMALL, Tracking.OK)) for view in (here, another, another, here)]
    assert [belief.status is BeliefStatus.TRACKING for belief in told] == [True, False, False, True]
    assert _wrong_m(told[-1], PATH[0]) < 0.05


def _corridor_walk(match_every):
    """A corridor 2 m wide seen by a camera that recognises nothing; odometry turns 0.3 degrees too far at each step."""
    probability = np.full((22, 200), 0.02, np.float32)
    probability[[0, 20]] = probability[:, [0, 199]] = 0.98
    grid = OccupancyGrid(probability, 0.1, (0.0, 0.0))
    part = SiftDb(match_every=match_every).build(context())
    part.learn([], grid)
    part.start(Belief(se2(17.0, 1.05, np.pi), SMALL))
    bearings = np.linspace(-0.5, 0.5, 161)
    wrong_m = []
    for k in range(60):
        truth = se2(17.0 - 0.2 * k, 1.05, np.pi)
        ranges = cast(grid.occupied(), grid, truth[:2, 3], bearings + np.pi, 8.0) + 0.05
        seen = Observation(k, 0.1 * k, context().camera, scan=Scan(bearings, ranges, 8.0))
        step = se2(0.2, 0.0, 0.005) if k else np.eye(4)
        belief = part.update(seen, Motion(step, SMALL, Tracking.OK))
        wrong_m.append(_wrong_m(belief, truth))
    return wrong_m, belief


def test_where_nothing_is_recognised_the_walls_hold_the_robot():
    by_odometry, _ = _corridor_walk(match_every=0)
    by_walls, belief = _corridor_walk(match_every=3)
    assert by_odometry[-1] > 1.0  # out of the corridor
    assert max(by_walls) < 0.25 and belief.status is BeliefStatus.TRACKING


@pytest.mark.parametrize("wrong", [
    {"match_every": -1}, {"every": 0}, {"retrieval": "magic"}, {"p_true": np.nan}, {"lost_below": 0.95}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=rf"^localiser\.{next(iter(wrong))}="):
        make(SiftDb, wrong, "localiser")


def test_one_answer_is_believed_as_far_as_answers_are_right_and_two_much_more():
    trust = Trust(p_true=0.9, kidnap=1e-9)
    claim = PlaceFix(se2(3.0, 0.0, 0.0), SMALL, 1.0)
    once = update(begin(None, None), [claim], 30.0, trust)
    assert once.best.weight == pytest.approx(0.9, abs=1e-6)
    twice = update(once, [claim], 30.0, trust)
    assert twice.best.weight > 0.995


def test_twins_claimed_side_by_side_stay_undecided_until_one_is_missing():
    here, there = PlaceFix(se2(3.0, 0.0, 0.0), SMALL, 0.5), PlaceFix(se2(9.0, 0.0, 0.0), SMALL, 0.5)
    state = begin(None, None)
    for _ in range(5):
        state = update(predict(state, np.eye(4), SMALL, Trust()), [here, there], 30.0, Trust())
    assert max(g.weight for g in state.guesses) < 0.55
    state = update(state, [PlaceFix(here.map_from_body, SMALL, 1.0)], 30.0, Trust())
    assert state.best.weight > 0.95
    np.testing.assert_allclose(state.best.map_from_body, here.map_from_body, atol=1e-9)


def test_a_single_wrong_answer_does_not_move_a_robot_that_knows_its_place():
    state = begin(se2(1.0, 0.0, 0.0), SMALL, 0.999)
    state = update(state, [PlaceFix(se2(9.0, 0.0, 0.0), SMALL, 1.0)], 30.0, Trust())
    np.testing.assert_array_equal(state.best.map_from_body, se2(1.0, 0.0, 0.0))
    assert state.best.weight > 0.8


def test_nearby_answers_pull_the_pose_by_the_kalman_gain():
    claim = PlaceFix(se2(0.02, 0.0, 0.0), SMALL, 1.0)
    state = update(begin(np.eye(4), SMALL), [claim], 30.0, Trust())
    assert state.best.map_from_body[0, 3] == pytest.approx(0.01)
    assert state.best.covariance[0, 0] == pytest.approx(SMALL[0, 0] / 2)


def test_a_place_does_not_tilt_a_robot_that_was_lost_for_a_while():
    """Height and roll known to 1.2 m and 24 degrees, and nine tenths of what is not known of them in common with x and y."""
    sigmas = np.array([0.05, 0.05, 1.2, 0.4, 0.4, 0.01])
    common = np.eye(6)
    common[0, 2] = common[2, 0] = common[1, 3] = common[3, 1] = 0.9
    state = predict(begin(np.eye(4), sigmas[:, None] * common * sigmas, 0.99), se2(0.1, 0.0, 0.0), SMALL, Trust())
    place = PlaceFix(se2(0.13, 0.02, 0.0), np.diag([0.02**2] * 6), 1.0)
    pose = update(state, [place], 30.0, Trust()).best.map_from_body
    assert pose[0, 3] == pytest.approx(0.126, abs=0.004) and pose[1, 3] == pytest.approx(0.017, abs=0.004)
    np.testing.assert_allclose([pose[2, 3], pose[2, 0], pose[2, 1]], 0.0, atol=1e-9)
