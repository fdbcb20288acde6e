"""What it takes to be sure again, and what to be sure no longer."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from painted_survey import FEATURES, SMALL, context, look, ring, survey

from rhs.api.geometry import inverse, se2
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.api.records import Belief, BeliefStatus, Features, Motion, Observation, Scan, Tracking
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.views.explainability import expected
from rhs.estimation.views.features import share
from rhs.estimation.views.motion_consistency import Continuity
from rhs_localisers.advanced import ConfirmationRules
from rhs_localisers.config import ParticleFilter, SiftDb
from rhs_localisers.confirmation import Confirmation, Contradiction, fits, hidden
from rhs_localisers.continuity_watch import ContinuityWatch

STILL, ON = np.eye(4), se2(0.26, 0.0, 0.0)
GOES_ON, UNKNOWN, BROKEN = Continuity.GOES_ON, Continuity.UNKNOWN, Continuity.BROKEN


def _round(angle):
    return se2(1.4 * np.cos(angle), 1.4 * np.sin(angle), angle + 1.5)


def test_places_vouch_again_after_four_that_agree_over_a_metre_and_a_half_and_not_on_the_spot():
    part = Confirmation(False)
    for _ in range(10):
        part.travel(STILL, GOES_ON)
        part.place_named(agrees=True)
    assert not part.confirmed and part.chance < 0.7
    for _ in range(6):
        part.travel(ON, GOES_ON)
        part.place_named(agrees=True)
    assert part.confirmed and part.chance == 1.0


def test_a_place_named_elsewhere_makes_the_count_begin_anew_but_does_not_overthrow_what_is_known():
    part, known = Confirmation(False), Confirmation(True)
    for k in range(11):
        part.travel(ON, GOES_ON)
        part.place_named(agrees=k != 5)
    assert not part.confirmed
    known.place_named(agrees=False)
    assert known.confirmed


def test_a_belief_that_leaps_off_its_own_motion_is_doubted():
    part = Confirmation(True)
    part.follow(np.array([1.0, 2.0, 3.1]), np.array([1.1, 2.0, -3.1]))
    assert part.confirmed
    part.follow(np.array([1.0, 2.0, 3.1]), np.array([3.0, 2.0, 3.1]))
    assert not part.confirmed and part.chance < 0.5


def test_a_belief_divided_between_two_places_keeps_that_it_was_named_and_a_contradiction_does_not():
    part = Confirmation(True)
    part.place_named(agrees=True)
    part.divided()
    assert not part.confirmed and part.chance == pytest.approx(0.6)  # its weight, a half, says the rest
    for _ in range(4):
        part.place_named(agrees=True)
    part.travel(ON, GOES_ON)
    assert not part.confirmed and part.chance < 0.7  # those that confirm began anew
    part.place_named(agrees=False)
    part.doubt()
    assert part.chance == pytest.approx(0.2)


def test_names_elsewhere_halve_the_chance_of_a_loose_belief_and_take_little_from_one_that_is_held():
    contradiction, elsewhere = Contradiction(), [np.array([9.0, 9.0, 0.0])]
    for _ in range(3):
        contradiction.convinces(elsewhere, against=True, held=True)
    assert contradiction.chance(held=False) == pytest.approx(0.125)
    assert contradiction.chance(held=True) == pytest.approx(0.97**3)
    for _ in range(100):  # on the spot: they would never overthrow it, so they do not take all of its chance either
        contradiction.convinces(elsewhere, against=True, held=True)
    assert contradiction.chance(held=True) > 0.8


def test_a_break_is_a_doubt_and_a_view_that_cannot_tell_is_not():
    part = Confirmation(True)
    part.travel(ON, UNKNOWN)
    assert part.confirmed and not part.held
    part.place_named(agrees=True)
    assert part.held
    part.travel(ON, BROKEN)
    assert not part.confirmed


def test_silence_tells_a_robot_that_may_have_been_carried_at_once_and_one_that_watched_its_way_after_two_metres():
    watching, blind = Confirmation(True), Confirmation(True)
    blind.travel(STILL, UNKNOWN)
    for part in (watching, blind):
        for _ in range(6):
            part.silent()
    assert watching.confirmed and not watching.silent() and not blind.confirmed
    for _ in range(8):
        watching.travel(ON, GOES_ON)
    watching.silent()
    assert not watching.confirmed


@pytest.mark.parametrize("held, metres", [(True, ConfirmationRules().against_m), (False, 0.5)])
def test_places_named_elsewhere_convince_a_robot_that_watched_its_way_only_after_three_metres(held, metres):
    contradiction, named, way_m = Contradiction(), se2(4.0, 2.0, 1.0), 0.0
    assert contradiction.convinces([np.array([9.0, 9.0, 0.0])], against=False, held=held)
    while not contradiction.convinces([np.array([named[0, 3], named[1, 3], 1.0])], against=True, held=held):
        contradiction.move(ON)
        named, way_m = named @ ON, way_m + 0.26
        assert way_m < 4.0
    assert metres <= way_m < metres + 0.27


def test_a_name_that_is_not_heard_again_for_two_metres_is_forgotten():
    contradiction = Contradiction()
    contradiction.convinces([np.array([9.0, 9.0, 0.0])], against=True, held=False)
    contradiction.move(se2(1.9, 0.0, 0.0))
    assert contradiction.pending == 1 and contradiction.chance(held=False) == 0.5
    contradiction.move(se2(0.2, 0.0, 0.0))
    assert contradiction.pending == 0 and contradiction.chance(held=False) == 1.0


def test_names_that_do_not_move_as_the_robot_does_never_convince():
    contradiction = Contradiction()
    for k in range(30):
        contradiction.move(ON)
        assert not contradiction.convinces([np.array([2.0 * k, 0.0, 0.0])], against=True, held=False)


def _room():
    room = np.full((60, 60), 0.02, np.float32)
    room[[0, -1]], room[:, [0, -1]] = 0.98, 0.98
    return OccupancyGrid(room, 0.1, (0.0, 0.0))


def _walls():
    return ScanMatcher(_room())


def _facing(metres):
    """A wall straight ahead."""
    bearings = np.linspace(-0.4, 0.4, 21)
    return Scan(bearings, metres / np.cos(bearings), 8.0)


MIDDLE, NEARER = np.array([3.0, 3.0, 0.0]), np.array([4.5, 3.0, 0.0])


def test_a_scan_fits_only_where_it_can_have_been_taken():
    assert fits(_facing(2.95), _walls(), MIDDLE) and not fits(_facing(2.95), _walls(), NEARER)
    assert fits(None, _walls(), NEARER)
    assert _walls().room_m(MIDDLE) == pytest.approx(2.9, abs=0.11)


def test_somebody_before_the_wall_hides_what_is_behind_and_a_scan_from_elsewhere_hides_nothing():
    somebody = _facing(2.95)
    ranges = somebody.ranges_m.copy()
    ranges[:7] = 0.8
    assert hidden(replace(somebody, ranges_m=ranges), _room(), MIDDLE)
    assert not hidden(_facing(2.95), _room(), MIDDLE), "the wall stands where the map has it"
    ranges[7:] = 5.0
    assert not hidden(replace(somebody, ranges_m=ranges), _room(), MIDDLE), "nobody sees through a wall"


def test_without_key_points_scans_tell_whether_a_view_goes_on():
    def seen(scan, pose, before=None):
        part = ContinuityWatch(FEATURES, _walls())
        for scan_of_view in (before, scan):
            view = Observation(0, 0.0, None, scan=scan_of_view)
            share(view, FEATURES, Features(np.empty((0, 2)), np.empty((0, 128)), np.empty((0, 3))))
            out = part.goes_on(view, Motion(STILL, SMALL, Tracking.OK), pose)
        return out

    assert seen(_facing(2.95), MIDDLE) is GOES_ON  # it lies on the walls of the map
    assert seen(_facing(2.95), NEARER) is UNKNOWN and seen(_facing(2.95), None) is UNKNOWN
    assert seen(_facing(2.95), MIDDLE, before=_facing(1.5)) is BROKEN
    assert seen(None, MIDDLE) is UNKNOWN


def test_key_points_of_somebody_close_by_do_not_outvote_half_of_a_scan():
    """The picture changes altogether; the wall stands where it stood in two thirds or four fifths of the fan, or nowhere.
    Where four fifths lie on the wall of the map too, nobody was carried off, unless the odometry says it lost its way."""
    def seen(after, walls=None, status=Tracking.OK, before=None):
        part = ContinuityWatch(FEATURES, walls)
        for angle, scan in ((0.1, before or _facing(2.95)), (3.2, after)):
            view = look(_round(angle))
            out = part.goes_on(replace(view, scan=scan), Motion(STILL, SMALL, status), MIDDLE)
        return out

    def somebody(beams):
        wall = _facing(2.95)
        return replace(wall, ranges_m=np.where(np.arange(len(wall.ranges_m)) < beams, 0.8, wall.ranges_m))

    assert seen(somebody(7)) is UNKNOWN and seen(somebody(4)) is UNKNOWN
    assert seen(somebody(7), _walls()) is UNKNOWN and seen(somebody(4), _walls()) is GOES_ON
    gone = {"before": somebody(7)}
    assert seen(_facing(2.95), _walls(), **gone) is GOES_ON
    assert seen(_facing(2.95), _walls(), Tracking.LOST, **gone) is UNKNOWN
    assert seen(_facing(2.5), _walls()) is BROKEN and seen(None, _walls()) is BROKEN


class _Stored(SimpleNamespace):
    def __len__(self):
        return len(self.stands)


def test_what_stored_views_of_bare_walls_do_not_recognise_tells_nothing():
    """Two stored views stand where the robot does, of 100 key-points each, or of 30 each; their neighbours explain them."""
    query = Features(np.zeros((90, 2)), np.zeros((90, 128)), np.zeros((90, 3)))
    for stored, tells in ((100, True), (30, False)):
        memory = _Stored(stands=np.zeros((2, 3)), placed=np.full(2, stored), points=np.zeros((1, 3)),
                         explained={0: 1.0, 1: 1.0})
        assert expected(memory, query, np.eye(4)) == tells


def test_a_belief_that_no_place_confirms_any_longer_loses_half_its_chance_every_two_metres():
    part = Confirmation(False)
    part.place_named(agrees=True)
    assert part.chance == pytest.approx(0.6)
    for _ in range(2):
        part.travel(se2(1.0, 0.0, 0.0), GOES_ON)
    assert part.chance == pytest.approx(0.5 * (0.6 + 0.35 * 0.25))
    part.place_named(agrees=True)
    assert part.chance > 0.75


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
        status.append([belief.status is BeliefStatus.TRACKING for belief in beliefs])
    assert all(status[0]) and not any(status[1])
    assert beliefs[-1].probability <= 0.5
