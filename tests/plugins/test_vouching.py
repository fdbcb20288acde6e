"""What it takes to be sure again, and which view cannot follow which."""

import numpy as np
import pytest
from painted_survey import FEATURES, SMALL, context, look, ring, survey

from rhs.geometry import inverse, se2
from rhs.grid import OccupancyGrid, frame_of
from rhs.records import Belief, Knowing, Motion, Tracking
from rhs.support import breaks
from rhs.vision import features
from rhs_localisers.particle_filter_config import ParticleFilter
from rhs_localisers.sift_db_config import SiftDb
from rhs_localisers.vouching import Vouching

STILL = np.eye(4)


def _round(angle):
    return se2(1.4 * np.cos(angle), 1.4 * np.sin(angle), angle + 1.5)


def test_places_vouch_again_after_four_that_agree_over_a_metre_and_not_on_the_spot():
    part = Vouching(False)
    for _ in range(10):
        part.travel(STILL)
        part.hear(True)
    assert not part.vouched and part.chance < 0.7
    for _ in range(4):
        part.travel(se2(0.26, 0.0, 0.0))
        part.hear(True)
    assert part.vouched and part.chance == 1.0


def test_a_place_named_elsewhere_makes_the_count_begin_anew_but_does_not_overthrow_what_is_known():
    part, known = Vouching(False), Vouching(True)
    for k in range(8):
        part.travel(se2(0.26, 0.0, 0.0))
        part.hear(k != 4)
    assert not part.vouched
    known.hear(False)
    assert known.vouched


def test_a_belief_that_leaps_off_its_own_motion_is_doubted():
    part = Vouching(True)
    part.follow(np.array([1.0, 2.0, 3.1]), np.array([1.1, 2.0, -3.1]))
    assert part.vouched
    part.follow(np.array([1.0, 2.0, 3.1]), np.array([3.0, 2.0, 3.1]))
    assert not part.vouched and part.chance < 0.5


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.5, 4.0])
def test_a_view_goes_on_from_the_last_by_the_motion_between_and_not_from_across_the_room(angle):
    before, after, across = (look(_round(a)) for a in (angle, angle + 0.1, angle + 3.1))
    step = inverse(_round(angle)) @ _round(angle + 0.1)
    last = features(before, FEATURES)
    assert not breaks(last, features(after, FEATURES), before.camera, step)
    assert breaks(last, features(across, FEATURES), before.camera, step)
    assert not breaks(None, features(across, FEATURES), before.camera, step)


@pytest.mark.parametrize("settings", [ParticleFilter(), SiftDb(match_every=0)])
def test_a_robot_carried_to_where_no_place_is_known_is_not_sure_in_a_single_view(settings):
    """The survey saw half of the room; the robot is carried to the other half, and its odometry notices nothing."""
    shape, origin_m = frame_of((-4.0, -3.0, 4.0, 3.0), 0.1)
    part = settings.build(context())
    part.learn(survey(ring(24)[:12]), OccupancyGrid(np.full(shape, 0.02, np.float32), 0.1, origin_m))
    path = [_round(a) for a in 0.3 + 0.1 * np.arange(6)]
    part.start(Belief(path[0], SMALL))
    status = []
    for route in (path, [_round(a) for a in 4.0 + 0.1 * np.arange(10)]):
        steps = [STILL] + [inverse(a) @ b for a, b in zip(route[:-1], route[1:], strict=True)]
        beliefs = [part.update(look(a), Motion(s, SMALL, Tracking.OK)) for a, s in zip(route, steps, strict=True)]
        status.append([belief.status is Knowing.TRACKING for belief in beliefs])
    assert all(status[0]) and not any(status[1])
    assert beliefs[-1].probability <= 0.5
