"""Monte Carlo localisation: by scans in a drawn room, by places in the painted room."""

from types import SimpleNamespace

import numpy as np
import pytest
from painted_survey import FEATURES, SMALL, context, look, ring, survey

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, planar, se2
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.api.records import Belief, BeliefStatus, Features, Motion, Observation, Scan, Tracking
from rhs.api.settings import make
from rhs.estimation.scans.rays import cast
from rhs.estimation.views.features import features, share
from rhs_localisers.config import ParticleFilter, ParticleFilterScan, SiftDb


def _house() -> OccupancyGrid:
    """Two rooms, 5 x 4 m and 3 x 4 m, with a door and a chest: every corner differs."""
    probability = np.full((41, 81), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    probability[:25, 50] = probability[35:, 50] = 0.98
    probability[1:8, 60:70] = probability[28:, 12:16] = 0.98
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


HOUSE = _house()


def _scan(state):
    bearings = np.linspace(-2.0, 2.0, 181)
    return Scan(bearings, cast(HOUSE.occupied(), HOUSE, state[:2], bearings + state[2], 8.0) + 0.05, 8.0)


def _walk(part, start, moves):
    """Truth and beliefs along exact motions."""
    truth, beliefs = se2(*start), []
    for k, move in enumerate([(0.0, 0.0)] + moves):
        step = se2(move[0], 0.0, move[1])
        truth = truth @ step
        seen = Observation(k, 0.1 * k, None, scan=_scan(planar(truth)))
        beliefs.append(part.update(seen, Motion(step, 1e-6 * np.eye(6), Tracking.OK)))
    return truth, beliefs


def _scan_filter(seed=0, **settings):
    part = ParticleFilterScan(**settings).build(SimpleNamespace(rng=np.random.default_rng(seed)))
    part.learn([], HOUSE)
    return part


def _wrong(belief, truth):
    gap = planar(inverse(truth) @ belief.map_from_body)
    return float(np.hypot(*gap[:2])), abs(float(gap[2]))


ROUND = [(0.2, 0.0)] * 8 + [(0.0, 0.3)] * 5 + [(0.15, 0.0)] * 8


def test_scans_alone_find_the_robot_that_may_be_anywhere_or_say_that_they_did_not():
    found = 0
    for seed, start in enumerate([(1.0, 1.0, 0.0), (2.0, 2.0, 0.3), (3.0, 0.8, 0.5), (0.8, 1.5, -0.3)]):
        part = _scan_filter(seed)
        part.start(None)
        truth, beliefs = _walk(part, start, ROUND)
        metres, radians = _wrong(beliefs[-1], truth)
        right = metres < 0.25 and radians < 0.09
        found += right
        assert right or beliefs[-1].status is not BeliefStatus.TRACKING
    assert found >= 3


def test_it_does_not_claim_to_know_before_it_has_seen_anything():
    part = _scan_filter()
    part.start(None)
    belief = part.update(Observation(0, 0.0, None), Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK))
    assert belief.status is BeliefStatus.LOST and belief.probability < 0.2


def test_a_known_start_stays_known_and_sharp():
    part = _scan_filter()
    part.start(Belief(se2(1.0, 1.0, 0.0), np.diag([1e-3] * 6)))
    truth, beliefs = _walk(part, (1.0, 1.0, 0.0), ROUND)
    assert all(belief.status is BeliefStatus.TRACKING for belief in beliefs)
    assert _wrong(beliefs[-1], truth)[0] < 0.12
    assert beliefs[-1].details["particles"] < 1500


def test_a_robot_carried_off_notices_and_finds_itself():
    part = _scan_filter(seed=3)
    part.start(Belief(se2(1.0, 1.0, 0.0), np.diag([1e-3] * 6)))
    _walk(part, (1.0, 1.0, 0.0), [(0.1, 0.0)] * 3)
    truth, beliefs = _walk(part, (6.5, 2.0, 2.5), [(0.0, 0.3)] * 20 + [(0.1, 0.2)] * 15)
    assert any(belief.status is not BeliefStatus.TRACKING for belief in beliefs)
    assert _wrong(beliefs[-1], truth)[0] < 0.25 and beliefs[-1].status is BeliefStatus.TRACKING


def test_a_robot_carried_off_in_a_room_that_looks_alike_both_ways_round_states_at_most_an_even_chance():
    part = _scan_filter(seed=4)
    probability = np.full((41, 61), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    room = OccupancyGrid(probability, 0.1, (0.0, 0.0))
    part.learn([], room)
    part.start(Belief(se2(1.0, 1.0, 0.0), np.diag([1e-3] * 6)))
    truth, beliefs = se2(1.0, 1.0, 0.0), []
    for k in range(12):
        if k == 4:
            truth = se2(4.0, 2.5, 2.0)  # its double is (2.1, 1.6, -1.14)
        step = se2(0.1, 0.0, 0.05)
        truth = truth @ step
        x, y, yaw = planar(truth)
        bearings = np.linspace(-2.0, 2.0, 181)
        scan = Scan(bearings, cast(room.occupied(), room, np.array([x, y]), bearings + yaw, 8.0) + 0.05, 8.0)
        beliefs.append(part.update(Observation(k, 0.1 * k, None, scan=scan), Motion(step, 1e-6 * np.eye(6), Tracking.OK)))
    assert all(belief.status is BeliefStatus.TRACKING for belief in beliefs[1:4])
    assert all(belief.status is not BeliefStatus.TRACKING for belief in beliefs[4:])
    assert 0.1 < beliefs[-1].probability < 0.6  # even, less what a belief that has just changed its mind has to show yet


def test_the_same_seed_gives_the_same_belief():
    ends = []
    for _ in range(2):
        part = _scan_filter(seed=5)
        part.start(None)
        ends.append(_walk(part, (1.0, 1.0, 0.0), ROUND[:6])[1][-1].map_from_body)
    np.testing.assert_array_equal(ends[0], ends[1])


def _blank_grid():
    shape, origin_m = frame_of((-4.0, -3.0, 4.0, 3.0), 0.1)
    return OccupancyGrid(np.full(shape, 0.02, np.float32), 0.1, origin_m)


def test_places_find_the_robot_and_find_it_again_after_it_was_carried_off():
    part = ParticleFilter().build(context())
    part.learn(survey(ring(24)), _blank_grid())
    part.start(None)
    for begin in (0.1, 3.2):
        angles = begin + 0.1 * np.arange(16)  # 2.1 m: places have to agree with the motion over a metre and a half
        path = [se2(1.4 * np.cos(a), 1.4 * np.sin(a), a + 1.5) for a in angles]
        for k, pose in enumerate(path):
            step = np.eye(4) if k == 0 else inverse(path[k - 1]) @ pose
            belief = part.update(look(pose), Motion(step, SMALL, Tracking.OK))
        metres, radians = _wrong(belief, path[-1])
        assert metres < 0.15 and radians < 0.06 and belief.status is BeliefStatus.TRACKING


def _barred(state, reach_m):
    scan = _scan(state)
    return Scan(scan.bearings_rad, np.minimum(scan.ranges_m, reach_m), 8.0)


def test_something_new_in_the_way_does_not_move_a_robot_that_knows_where_it_is():
    """A board half a metre away fills the view: nothing of the map fits, and walls elsewhere would fit better."""
    part = ParticleFilter().build(context())
    part.learn([], HOUSE)
    start = (2.0, 1.5, 0.0)
    part.start(Belief(se2(*start), np.diag([1e-3] * 6)))
    for k in range(12):
        seen = Observation(k, 0.1 * k, context().camera, scan=_barred(start, 0.8))
        belief = part.update(seen, Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK))
    metres, radians = _wrong(belief, se2(*start))
    assert belief.status is BeliefStatus.TRACKING and metres < 0.25 and radians < 0.1


@pytest.mark.parametrize("wrong", [
    {"surprise": -1.0}, {"particles_min": 0}, {"particles_min": 5000}, {"scan_trust": 2.0}, {"p_true": 0.1}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=rf"^localiser\.{next(iter(wrong))}="):
        make(ParticleFilter, wrong, "localiser")


def _blinded(pose):
    """A view with as many key-points as the room's, none of which is in the memory."""
    seen, rng = look(pose), np.random.default_rng(5)
    known = features(seen, FEATURES)
    other = np.abs(rng.standard_normal((len(known.pixels), 128))).astype(np.float32)
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    blind = Observation(0, 0.0, seen.camera)
    share(blind, FEATURES, Features(known.pixels, other, known.points))
    return blind


@pytest.mark.parametrize("settings", [ParticleFilter(), SiftDb(match_every=0)])
def test_a_robot_that_recognises_nothing_where_it_should_says_that_it_doubts(settings):
    part = settings.build(context())
    part.learn(survey(ring(24)), _blank_grid())
    path = [se2(1.5 * np.cos(a), 1.5 * np.sin(a), a + np.pi / 2) for a in 0.1 * np.arange(20)]
    part.start(Belief(path[0], SMALL))
    steps = [np.eye(4)] + [inverse(a) @ b for a, b in zip(path[:-1], path[1:], strict=True)]
    seeing = [part.update(look(pose), Motion(step, SMALL, Tracking.OK)) for pose, step in zip(path, steps, strict=True)]
    assert all(belief.status is BeliefStatus.TRACKING for belief in seeing)
    part.start(Belief(path[0], SMALL))
    blind = [part.update(_blinded(pose), Motion(step, SMALL, Tracking.OK)) for pose, step in zip(path, steps, strict=True)]
    assert blind[-1].status is not BeliefStatus.TRACKING and blind[-1].probability <= 0.5
