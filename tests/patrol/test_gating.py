"""The gate: what passes is untouched, what contradicts the wheels is replaced, spinning wheels are forgiven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.contracts import Odometry, complete
from rhs.api.errors import ContractError
from rhs.api.geometry import Camera, exp_se3, log_se3, planar, se2
from rhs.api.records import Motion, Observation, Revision, Scan, Tracking
from rhs.metrics.success import success_of
from rhs.patrol.gate import GatedOdometry, contradiction, gated, joined
from rhs.patrol.tasks import Gate

CAMERA = Camera(100.0, 100.0, 80.0, 60.0, 160, 120)
SURE = np.diag([1e-3] * 3 + [1e-3] * 3) ** 2
AHEAD = (0.25, 0.0, 0.0)


class Told(Odometry):
    """An odometry that says what it was told to."""

    def __init__(self, *motions: Motion) -> None:
        self.motions = [Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view"), *motions]

    def update(self, observation: Observation) -> Motion:
        return self.motions[observation.index]

    def revise(self) -> Revision:
        return Revision(np.array([np.eye(4)] * len(self.motions)), (None,) * len(self.motions))


def said(x: float, y: float = 0.0, yaw: float = 0.0, status: Tracking = Tracking.OK) -> Motion:
    return Motion(se2(x, y, yaw), SURE, status, observability=np.ones(6))


def through(motions: list[Motion], wheels: list[tuple | None], hz: float = 10.0, **settings) -> list[Motion]:
    part = GatedOdometry(Told(*motions), Gate(**settings))
    views = [Observation(0, 5.0, CAMERA)]
    for index, wheel in enumerate(wheels, 1):
        travel = None if wheel is None else np.array(wheel)
        views.append(Observation(index, 5.0 + index / hz, CAMERA, wheel=travel))
    return [part.update(view) for view in views][1:]


def test_a_motion_that_agrees_is_handed_on_untouched() -> None:
    good = said(0.251, 0.002, 0.004)
    passed = through([good], [AHEAD])[0]
    assert np.array_equal(passed.previous_from_body, good.previous_from_body)
    assert np.array_equal(passed.covariance, good.covariance)
    assert passed.status is Tracking.OK and passed.reason == ""


@pytest.mark.parametrize("wrong", [(0.9, 0.0, 0.0), (0.25, 0.4, 0.0), (0.25, 0.0, 0.5), (-0.2, 0.0, 0.0)])
def test_a_confident_contradiction_is_replaced_by_the_wheels(wrong: tuple) -> None:
    motion = through([said(*wrong)], [AHEAD])[0]
    assert motion.status is Tracking.LOST
    assert motion.reason.startswith("gated: ") and motion.reason.endswith("took wheel")
    assert planar(motion.previous_from_body) == pytest.approx(AHEAD)
    # 0.02 m and a tenth of 0.25 m; 0.02 rad
    assert np.sqrt(np.diag(motion.covariance))[[0, 1, 5]] == pytest.approx([0.045, 0.045, 0.02])
    assert np.linalg.eigvalsh(motion.covariance).min() > 0.0


def _room(x: float, y: float, yaw: float, mover_m: float) -> Scan:
    """In a room of 4 by 3 m, the left third of the fan on something mover_m away."""
    bearings = np.linspace(-0.5, 0.5, 100)
    way = np.stack([np.cos(bearings + yaw), np.sin(bearings + yaw)])
    walls = np.where(way > 0.0, [[2.0 - x], [1.5 - y]], [[-2.0 - x], [-1.5 - y]])
    ranges = (walls / way).min(axis=0)
    ranges[67:] = mover_m
    return Scan(bearings, ranges, 8.0)


def test_wheels_that_two_thirds_of_the_scan_agree_with_are_known_to_be_right():
    """A robot turns on the spot by 0.2 rad while somebody walks off: vision has it that the robot moved back."""
    wheel, wrong = np.array([0.0, 0.0, 0.2]), said(-0.16, 0.0, 0.2)

    def through_scans(*scans):
        part = GatedOdometry(Told(wrong), Gate())
        part.update(Observation(0, 5.0, CAMERA, scan=scans[0]))
        return part.update(Observation(1, 5.1, CAMERA, wheel=wheel, scan=scans[1]))

    motion = through_scans(_room(0.0, 0.0, 0.0, 0.9), _room(0.0, 0.0, 0.2, 1.1))
    assert motion.status is Tracking.DEGENERATE and motion.replaced and "the scan agrees with wheel" in motion.reason
    assert planar(motion.previous_from_body) == pytest.approx(wheel)
    carried = through_scans(_room(0.0, 0.0, 0.0, 0.9), _room(-1.0, 0.5, 2.0, 1.1))
    assert carried.status is Tracking.LOST and carried.reason.endswith("took wheel")


def test_where_wheels_are_doubted_less_the_scan_decides():
    """Vision has it that the robot moved back by 0.105 m, 5.2 sigmas of the wheels, of which the gate lets pass 5.5."""
    wheel, slight = np.array([0.0, 0.0, 0.2]), said(-0.105, 0.0, 0.2)
    turned = _room(0.0, 0.0, 0.0, 0.9), _room(0.0, 0.0, 0.2, 1.1)
    backed = _room(0.0, 0.0, 0.0, 0.9), _room(-0.105, 0.0, 0.2, 1.1)
    for scans, replaced in ((turned, True), (backed, False), ((None, None), False)):
        part = GatedOdometry(Told(slight), Gate())
        part.update(Observation(0, 5.0, CAMERA, scan=scans[0]))
        motion = part.update(Observation(1, 5.1, CAMERA, wheel=wheel, scan=scans[1]))
        assert motion.replaced == replaced
        assert planar(motion.previous_from_body) == pytest.approx(wheel if replaced else [-0.105, 0.0, 0.2])


@pytest.mark.parametrize(("moved_m", "known"), [(-0.2, True), (0.0, False)])
def test_a_robot_that_backs_off_before_somebody_who_follows_is_told_from_wheels_that_spin(moved_m, known):
    """Vision stands still before a third of the fan that comes along; two thirds tell whether the robot moved."""
    part = GatedOdometry(Told(said(0.0)), Gate())
    part.update(Observation(0, 5.0, CAMERA, scan=_room(0.0, 0.0, 0.0, 0.9)))
    motion = part.update(Observation(1, 5.1, CAMERA, wheel=np.array([-0.2, 0.0, 0.0]), scan=_room(moved_m, 0.0, 0.0, 0.9)))
    assert motion.replaced == known and motion.previous_from_body[0, 3] == pytest.approx(-0.2 if known else 0.0)


def test_an_unsure_motion_is_not_refused_for_the_same_difference() -> None:
    unsure = replace(said(0.9), covariance=np.diag([0.3, 0.3, 0.3, 0.1, 0.1, 0.1]) ** 2)
    assert through([unsure], [AHEAD])[0].status is Tracking.OK


def test_wheels_may_count_too_much_but_never_too_little() -> None:
    spread = np.diag([1e-3, 1e-3, 1e-3]) ** 2
    wheel = np.array([1.0, 0.0, 0.0])
    assert contradiction(said(0.5), wheel, spread, slip_share=0.5) == pytest.approx(0.0, abs=1e-9)
    # 0.1 m past what spinning explains, or past the wheels: 0.1^2 / (1e-6 + 1e-6)
    assert contradiction(said(0.4), wheel, spread, slip_share=0.5) == pytest.approx(5000.0)
    assert contradiction(said(1.1), wheel, spread, slip_share=0.5) == pytest.approx(5000.0)


def test_wheels_that_always_contradict_are_doubted() -> None:
    motions = through([said(0.25)] * 6, [(0.0, 0.0, 0.0)] * 6, patience=4)
    assert [m.status is Tracking.LOST for m in motions] == [True] * 4 + [False] * 2
    assert motions[-1].reason.endswith("wheels doubted")
    assert planar(motions[-1].previous_from_body) == pytest.approx(AHEAD)


def test_a_slide_along_a_flat_wall_gets_its_length_from_the_wheels() -> None:
    """Known to a millimetre across, to half a metre along: the wheels decide along, vision across."""
    slid = replace(said(0.1, 0.004, status=Tracking.DEGENERATE), covariance=SURE + np.diag([0.25, 0, 0, 0, 0, 0]))
    spread = np.diag([0.02, 0.02, 0.02]) ** 2
    x, y, _ = planar(joined(slid, np.array(AHEAD), spread).previous_from_body)
    assert x == pytest.approx(0.25, abs=0.001) and y == pytest.approx(0.004, abs=0.0002)
    motion = through([slid], [AHEAD])[0]
    assert motion.status is Tracking.DEGENERATE and "joined with wheel" in motion.reason
    assert planar(motion.previous_from_body)[0] == pytest.approx(0.25, abs=0.002)


def test_without_wheels_a_leap_is_refused_once() -> None:
    """1 m/s at 10 Hz, then 1 m in a tenth of a second: no; the same again and again: it is a fast vehicle."""
    motions = through([said(0.1), said(1.0), said(0.1)], [None] * 3)
    assert [m.status for m in motions] == [Tracking.OK, Tracking.LOST, Tracking.OK]
    assert motions[1].reason.endswith("took same again")
    assert planar(motions[1].previous_from_body) == pytest.approx((0.1, 0.0, 0.0))
    fast = through([said(0.1), said(1.0), said(1.0), said(1.0)], [None] * 4)
    assert [m.status is Tracking.OK for m in fast] == [True, False, True, True]


def test_no_speed_is_judged_by_stamps_that_nobody_measured() -> None:
    """A third of a metre and then a whole one, of numbered images that are given 30 stamps a second: a camera carried by a
    person who took a picture a second."""
    told, views = [said(0.3), said(1.0), said(0.3)], [Observation(k, k / 30.0, CAMERA) for k in range(4)]
    timed, untimed = (gated(Told(*told), frozenset({"depth"}), Gate(), timed=known) for known in (True, False))
    assert [timed.update(view).replaced for view in views] == [False, False, True, False]
    assert [untimed.update(view).replaced for view in views] == [False] * 4


def test_views_whose_stamps_come_in_clumps_are_no_leaps() -> None:
    """1 m/s at 10 Hz; two views at a time arrive within a millisecond, which would be 100 m/s. A real leap is one still."""
    stamps = [0.0, 0.001, 0.2, 0.201, 0.4, 0.401, 0.6]
    part = GatedOdometry(Told(*[said(0.1)] * 5, said(1.5)), Gate())
    assert [part.update(Observation(k, s, CAMERA)).replaced for k, s in enumerate(stamps)] == [False] * 6 + [True]


def test_what_follows_lost_views_may_put_their_guesses_right() -> None:
    lost = said(0.25, status=Tracking.LOST)
    motions = through([lost, lost, lost, said(0.6)], [AHEAD] * 4)
    assert motions[3].status is Tracking.OK
    assert through([said(0.25)] * 3 + [said(0.6)], [AHEAD] * 4)[3].status is Tracking.LOST


def test_a_revision_that_knows_nothing_of_replaced_motions_is_not_used() -> None:
    for motion, kept in ((said(0.25), True), (said(2.0), False)):
        part = GatedOdometry(Told(motion), Gate())
        for index in range(2):
            part.update(Observation(index, float(index), CAMERA, wheel=np.array(AHEAD)))
        assert (part.revise() is not None) == kept


def test_only_odometries_with_depth_are_gated() -> None:
    part = Told()
    assert gated(part, frozenset({"wheel"}), Gate()) is part
    assert gated(part, frozenset({"image", "depth"}), Gate(act="off")) is part
    assert isinstance(gated(part, frozenset({"depth"}), Gate()), GatedOdometry)


def test_what_an_odometry_offers_beside_motions_passes_the_gate():
    part = Told()
    part.keeps_moving, part.short_steps, part.scale_from = (0.125, 6.5), (0.1, 3.0), "a barcode"
    behind = gated(part, frozenset({"depth"}), Gate())
    assert (behind.keeps_moving, behind.short_steps, behind.scale_from) == ((0.125, 6.5), (0.1, 3.0), "a barcode")
    assert GatedOdometry(Told(), Gate()).keeps_moving is None


def test_a_part_that_derives_from_nothing_is_given_the_defaults_of_its_contract():
    class Plain:
        camera = facts = scale_from = "a barcode"

        def update(self, observation):
            return None

        def lead(self):
            return None

    class Closed:
        __slots__ = ()

        update = Plain.update

    assert (complete("odometry", Plain()).keeps_moving, complete("odometry", Plain()).scale_from) == (None, "a barcode")
    assert complete("odometry", Plain()).revise() is None
    source = complete("source", Plain())
    assert (source.provides, source.renderer, source.lost, source.truth()) == (None, "", "", None)
    with pytest.raises(ContractError, match="derive it from rhs.api.contracts.Odometry"):
        complete("odometry", Closed())


def test_a_robot_on_wheels_does_not_tilt_where_vision_hardly_knows():
    """17 degrees of roll known to 30, as where somebody's coat has the picture: the floor knows better."""
    said = Motion(exp_se3(np.array([0.2, 0.0, 0.3, 0.3, 0.0, 0.0])), np.diag([0.5**2] * 6), Tracking.DEGENERATE, "few")
    motion = joined(said, np.array([0.2, 0.0, 0.0]), np.diag([0.02, 0.02, 0.01]) ** 2)
    twist = log_se3(motion.previous_from_body)
    np.testing.assert_allclose(twist, [0.2, 0.0, 0.3 / 101.0, 0.3 / 101.0, 0.0, 0.0], atol=2e-3)  # 0.05^2 against 0.5^2
    np.testing.assert_allclose(np.sqrt(np.diag(motion.covariance))[2:5], 0.05, rtol=0.01)


@pytest.mark.parametrize(("way", "turn", "said_of"), [
    (1.0, 1.0, ""), (1.1, 0.9, ""), (1.0, -1.0, "-1 times the turn"), (0.0, 1.0, "0 times the way"),
    (100.0, 1.0, "1e+02 times the way"), (1.0, 180.0 / np.pi, "57 times the turn")])
def test_wheels_in_another_unit_or_of_another_sign_are_known_by_what_was_seen(way: float, turn: float, said_of: str) -> None:
    """A recording's camera, sure of a way of 0.1 m and turns of 0.1 rad; every fourth view says nothing."""
    seen = [(0.1, 0.0, 0.0), (0.02, 0.0, 0.1), (0.5, 0.0, 0.0), (0.02, 0.0, -0.1)] * 25
    motions = [said(*one, status=Tracking.LOST if one[0] == 0.5 else Tracking.OK) for one in seen]
    wheels = [(way * x, 0.0, turn * yaw) for x, _, yaw in seen]
    part = GatedOdometry(Told(*motions), Gate())
    part.update(Observation(0, 5.0, CAMERA))
    for index, wheel in enumerate(wheels, 1):
        part.update(Observation(index, 5.0 + 0.1 * index, CAMERA, wheel=np.array(wheel)))
    figures = part.wheel_figures()
    assert figures == pytest.approx({"wheel_way_ratio": way, "wheel_turn_ratio": turn})
    fault = success_of({"status": "ok", "tracked_share": 1.0, **figures})[1]
    assert fault.startswith(f"the wheels tell of {said_of}") if said_of else fault == ""


def test_few_views_say_nothing_of_the_wheels() -> None:
    part = GatedOdometry(Told(*[said(*AHEAD)] * 5), Gate())
    for index in range(5):
        part.update(Observation(index, 5.0 + 0.1 * index, CAMERA, wheel=np.array([25.0, 0.0, 0.0])))
    assert part.wheel_figures() == {}


@pytest.mark.parametrize(("late", "timed", "said_of"), [(3, True, 0.3), (0, True, 0.0), (3, False, np.nan)])
def test_views_that_come_after_the_wheels_are_known_by_their_turns(late: int, timed: bool, said_of: float) -> None:
    """A camera whose views are stamped `late` views after they were taken; not of a source that nobody timed."""
    yaws = 0.1 * np.sin(0.3 * np.arange(103))
    part = GatedOdometry(Told(*[said(0.1, 0.0, yaw) for yaw in yaws[3 - late:103 - late]]), Gate(), timed=timed)
    part.update(Observation(0, 5.0, CAMERA))
    for index, yaw in enumerate(yaws[3:], 1):
        part.update(Observation(index, 5.0 + 0.1 * index, CAMERA, wheel=np.array([0.1, 0.0, yaw])))
    assert part.views_late_s() == pytest.approx(said_of, abs=0.02, nan_ok=True)
    fault = success_of({"status": "ok", "tracked_share": 1.0, "views_late_s": part.views_late_s()})[1]
    assert ("source.views_late_s=0.3, " in fault) == (said_of > 0.0)
