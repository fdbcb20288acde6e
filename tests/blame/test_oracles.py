"""The truth in the place of a part: what each oracle answers, by hand."""

from dataclasses import dataclass

import numpy as np
import pytest

from rhs.api.geometry import planar, se2
from rhs.api.records import Belief, Capture, Motion, Tracking, Twist
from rhs.base.errors import RhsError
from rhs.blame.oracles import SURE, TrueClosing, TrueDrive, TrueLocaliser, TrueOdometry, Watched


class Slipping:
    """A source led over three views, whose robot goes half as far as it is told and cannot be put below y = -1."""

    camera = facts = None
    provides, renderer, lost, timed = None, "", "", True

    def __init__(self):
        self.pose, self.index = se2(1.0, 0.0, 0.0), 0

    def lead(self):
        if self.index == 3:
            return None
        self.index += 1
        self.pose = se2(float(self.index), 0.0, 0.0)
        return Capture(self.index, float(self.index))

    def begin_patrol(self):
        self.begun = True

    def drive(self, command):
        self.pose = self.pose @ se2(0.5 * command.forward_mps * command.duration_s, 0.0, 0.0)
        return Capture(9, 9.0, travel=np.zeros(3))

    def teleport(self, pose):
        if planar(pose)[1] < -1.0:
            raise RhsError("no room")
        self.pose = pose

    def truth(self):
        return self.pose.copy()

    def clearance_m(self):
        return float(self.index), False


def test_a_survey_is_shown_again_with_its_truths_and_then_the_source_goes_on():
    source = Watched(Slipping(), "source")
    shown = []
    while (capture := source.lead()) is not None:
        shown.append((capture.index, planar(source.truth())[0], source.clearance_m()[0]))
    assert shown == [(1, 1.0, 1.0), (2, 2.0, 2.0), (3, 3.0, 3.0)] and source.views_expected == 3
    source.begin_patrol()
    source.drive(Twist(1.0, 0.0, 1.0))
    assert planar(source.truth())[0] == pytest.approx(3.5) and source.source.begun


def test_a_command_is_carried_out_exactly_but_into_a_wall():
    inner = Slipping()
    source, command = TrueDrive(inner), Twist(1.0, 0.0, 0.4)
    seen = source.drive(command)
    assert planar(inner.truth())[0] == pytest.approx(1.4) and seen.travel == pytest.approx([0.4, 0.0, 0.0])
    assert seen.command is command
    inner.pose = se2(1.0, -0.9, -np.pi / 2)
    source.drive(command)
    assert planar(inner.truth())[1] == pytest.approx(-1.1)  # as far as the source itself goes


def test_a_quarter_circle_by_hand():
    assert Twist(np.pi / 2, np.pi / 2, 1.0).travel == pytest.approx([1.0, 1.0, np.pi / 2])


def test_odometry_closing_and_localiser_tell_the_truth():
    inner = Slipping()

    class Lost:
        keeps_moving, short_steps, scale_from = (0.1, 3.0), (0.2, 4.0), "steps"

        def update(self, observation):
            return Motion(np.eye(4), np.eye(6), Tracking.LOST)

    odometry = TrueOdometry(Lost(), inner, scans=False)
    assert odometry.keeps_moving == (0.1, 3.0) and odometry.short_steps == (0.2, 4.0)
    inner.lead()
    first = odometry.update(None)
    inner.lead()
    second = odometry.update(None)
    assert np.array_equal(first.previous_from_body, np.eye(4)) and second.status is Tracking.OK
    assert planar(second.previous_from_body) == pytest.approx([1.0, 0.0, 0.0])
    localiser = TrueLocaliser(inner)
    localiser.start(Belief(se2(9.0, 9.0, 0.0), SURE))
    assert planar(localiser.update(None, second).map_from_body) == pytest.approx([2.0, 0.0, 0.0])

    @dataclass
    class View:
        stamp_s: float
        map_from_body = se2(5.0, 5.0, np.pi / 2)

    closure = TrueClosing({0.5: se2(1.0, 0.0, 0.0), 1.0: se2(2.0, 0.0, 0.0)}).close([View(0.5), View(1.0)])
    assert planar(closure.poses[1]) == pytest.approx([5.0, 6.0, np.pi / 2])  # from where the survey began
