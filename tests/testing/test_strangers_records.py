"""Records of strangers that cannot be read, or that say what is not theirs to say: refused in their name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import ClassVar

import numpy as np
import pytest

import rhs
from rhs.api.contracts import Blockage, Blocked
from rhs.api.errors import ContractError
from rhs.api.geometry import camera_from_fov
from rhs.api.grid import OccupancyGrid
from rhs.api.records import (
    Capture,
    Closure,
    LoopEdge,
    Motion,
    Observation,
    Path,
    PlanReason,
    Revision,
    Scan,
    Tracking,
    View,
    Wall,
)
from rhs.api.validate import (
    check_capture,
    check_closure,
    check_grid,
    check_motion,
    check_observation,
    check_revision,
    check_scan,
)
from rhs.testing import check_plugin

MOTION = Motion(np.eye(4), np.eye(6), Tracking.OK)
SCAN = Scan(np.zeros(3), np.ones(3), 5.0)
CAMERA = camera_from_fov(32, 24, 60.0, height_m=1.0)
VIEWS = [View(k, float(k), CAMERA, MOTION, np.eye(4), np.eye(6), None, None) for k in range(3)]
EDGE = LoopEdge(0, 2, np.eye(4), np.eye(6), 10)
NOTHING: frozenset[str] = frozenset()


class OwnMotion(Motion):
    """With a constructor of its own."""

    def __init__(self):
        for name, value in vars(MOTION).items():
            object.__setattr__(self, name, value)


class Tensor:
    """Of another library."""


def said_of(check, *records):
    with pytest.raises(ContractError) as caught:
        check(*records, who="mine")
    assert str(caught.value).startswith("mine: ") and "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("change", "says"), [
    ({"scan": replace(SCAN, origin_xy_m=None)}, "cannot be read: TypeError"),
    ({"details": {"a": 10**400}}, "cannot be read: OverflowError"),
    ({"details": {"\udcff": 1.0}}, "cannot be read: UnicodeEncodeError"),
    ({"reason": "half a letter: \udcff"}, "cannot be read: UnicodeEncodeError"),
    ({"previous_from_body": Tensor()}, "previous_from_body is of type test_strangers_records.Tensor"),
    ({"scan_measured": "no"}, "scan_measured is 'no'; expected True or False"),
    ({"replaced": True}, "replaced is True; expected False: the gate alone replaces motions"),
])
def test_a_motion_that_cannot_be_read_is_refused_in_the_name_of_its_odometry(change, says):
    assert says in said_of(check_motion, replace(MOTION, **change))


def test_a_motion_of_a_class_that_cannot_be_copied_is_refused_in_the_name_of_its_odometry():
    assert "cannot be read: TypeError" in said_of(check_motion, OwnMotion())


def test_the_gate_may_say_that_it_replaced_a_motion():
    assert check_motion(replace(MOTION, replaced=True), who="gate", gated=True).replaced


@pytest.mark.parametrize(("change", "says"), [
    ({"earlier": 0.5}, "edges is views 0.5 and 2"), ({"earlier": "0"}, "edges is views '0' and 2"),
    ({"inliers": None}, "edges.inliers is None"), ({"accepted": "no"}, "edges.accepted is 'no'"),
    ({"covariance": -np.eye(6)}, "edges.covariance is variances"),
])
def test_a_loop_is_checked_as_a_motion_is(change, says):
    poses = np.array([np.eye(4)] * 3)
    assert says in said_of(check_closure, Closure(poses, (replace(EDGE, **change),)), VIEWS)
    known_no_better = replace(EDGE, covariance=np.full((6, 6), np.nan), accepted=False, reason="too few")
    assert check_closure(Closure(poses, (EDGE, known_no_better)), VIEWS, who="mine").edges[0].accepted


def test_walls_scans_and_grids_that_nothing_can_be_done_with_are_refused():
    poses = np.array([np.eye(4)] * 3)
    assert "cannot be read" in said_of(check_revision, Revision(poses, None, None), 3)
    assert "a floor below a ceiling" in said_of(check_revision, Revision(poses, None, (Wall(*np.eye(2), np.nan),)), 3)
    tiny = OccupancyGrid(np.zeros((4, 4), np.float32), 1e-9, (0.0, 0.0))
    assert "resolution_m is 1e-09; expected metres above 0: 0.001 to 1000" in said_of(check_grid, tiny)


def test_what_a_masked_array_hides_is_unknown():
    """The masked range was taken for the number under the mask."""
    masked = np.ma.masked_array([1.0, 2.0, 3.0], [False, True, False])
    known = check_scan(replace(SCAN, ranges_m=masked), who="mine").ranges_m
    assert np.array_equal(known, [1.0, np.nan, 3.0], equal_nan=True)
    assert "not finite" in said_of(check_motion, replace(MOTION, covariance=np.ma.masked_array(np.eye(6), np.eye(6) == 0.0)))


@pytest.mark.parametrize("extras", [{"imu": [1.0]}, {"imu": {"a": 1}}, {7: np.zeros(3)}, {"imu": np.array([None])}])
def test_an_extra_modality_is_an_array_of_numbers_by_a_name(extras):
    assert "expected an array of numbers by a name" in said_of(check_capture, Capture(0, 0.0, extras=extras))
    assert check_capture(Capture(0, 0.0, extras={"imu": np.zeros(3)}), who="mine").extras["imu"].shape == (3,)


def test_a_capture_counts_in_whole_numbers_and_a_wheel_goes_no_endless_way():
    for index in ("3", 2.5, -1):
        assert "the number of the view, 0 or more" in said_of(check_capture, Capture(index, 0.0))
    seen = Observation(0, 0.0, CAMERA, wheel=np.array([np.inf, 0.0, 0.0]))
    assert "NaN where unknown" in said_of(check_observation, seen, Capture(0, 0.0))


@dataclass
class Complains:
    """Raises what rhs raises, in words of its own; or draws what cannot be drawn, or answers in numbers that are none."""

    how: str = "raises"
    """what goes wrong"""
    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context):
        return self

    def plan(self, problem):
        if self.how == "raises":
            raise ContractError("no way here")
        points = np.array([problem.start_m, problem.goal_m])
        return Path(PlanReason.OK, 1j * points if self.how == "turns" else points, sketch=lambda: 1 / 0)


@pytest.mark.parametrize(("how", "says"), [
    ("raises", "failed in {here}:{raises}: ContractError: no way here"),  # named nobody
    ("draws", "failed in {here}:{draws}: ZeroDivisionError: division by zero"),  # was told with a line of rhs_tasks
    ("turns", "points_m has shape (2, 2) and type complex128; expected (N, 2) numbers"),  # was taken by half
])
def test_whatever_a_part_raises_is_told_with_its_own_line(how, says, tmp_path):
    words = {"task": "planning", "world": "map1", "planner": Complains(how), "output": str(tmp_path / "run")}
    reason = rhs.run(words, quiet=True)["reason"]
    lines = FilePath(__file__).read_text(encoding="utf-8").splitlines()
    at = {name: 1 + next(k for k, line in enumerate(lines) if code in line)
          for name, code in (("raises", 'raise ContractError("no way'), ("draws", "sketch=lambda"))}
    assert "planner=complains (test_strangers_records.py" in reason
    assert says.format(here="testing/test_strangers_records.py", **at) in reason


@dataclass
class Patient:
    """Waits longer for what was met before."""

    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context):
        return self

    def blocked(self, blockage: Blockage) -> Blocked:
        """The more often a place was put off, the longer it may wait."""
        if blockage.waited < 4 * (1 + blockage.skipped):
            return Blocked.WAIT
        return Blocked.REPLAN if not blockage.no_way else Blocked.GIVE_UP


def test_patience_that_grows_has_an_end():
    """It was asked about a place that had been put off ten thousand times; mission.tries allows a thousand."""
    check_plugin("replan", Patient())
