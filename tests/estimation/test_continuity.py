"""Which view can follow which."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import FEATURES, look

from rhs.api.geometry import inverse, se2
from rhs.api.records import Scan
from rhs.estimation.views.features import features
from rhs.estimation.views.motion_consistency import Continuity, continuity, scan_continuity


def _round(angle):
    return se2(1.4 * np.cos(angle), 1.4 * np.sin(angle), angle + 1.5)


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.5, 4.0])
def test_a_view_goes_on_from_the_last_by_the_motion_between_and_not_from_across_the_room(angle):
    before, after, across = (look(_round(a)) for a in (angle, angle + 0.1, angle + 3.1))
    step = inverse(_round(angle)) @ _round(angle + 0.1)
    last = features(before, FEATURES)
    assert continuity(last, features(after, FEATURES), before.camera, step) is Continuity.GOES_ON
    assert continuity(last, features(across, FEATURES), before.camera, step) is Continuity.BROKEN


def test_without_a_view_before_or_without_depth_nobody_can_tell():
    before, after = look(_round(0.1)), look(_round(0.2))
    step = inverse(_round(0.1)) @ _round(0.2)
    last, seen = features(before, FEATURES), features(after, FEATURES)
    flat = replace(last, points=np.full_like(last.points, np.nan))
    assert continuity(None, seen, before.camera, step) is Continuity.UNKNOWN
    assert continuity(flat, seen, before.camera, step) is Continuity.UNKNOWN


def _corridor(lateral_m, heading_rad, width_m=2.0, camera_m=0.1):
    """A scan between two endless walls, 0.1 m ahead of a body that stands beside the middle line."""
    bearings = np.linspace(-0.5, 0.5, 101)
    y = lateral_m + camera_m * np.sin(heading_rad)
    rise = np.sin(bearings + heading_rad)
    with np.errstate(divide="ignore"):
        ranges = np.where(rise > 0, (width_m / 2 - y) / rise, (-width_m / 2 - y) / rise)
    return Scan(bearings, np.where(ranges < 8.0, ranges, np.nan), 8.0, (camera_m, 0.0))


@pytest.mark.parametrize("step", [(0.25, 0.0, 0.0), (0.2, 0.05, 0.1), (0.0, 0.0, -0.12)])
def test_a_scan_in_a_corridor_goes_on_along_it_and_breaks_when_the_robot_is_set_down_off_the_line(step):
    move = se2(*step)
    before = _corridor(0.0, 0.0)
    assert scan_continuity(before, _corridor(step[1], step[2]), move) is Continuity.GOES_ON
    assert scan_continuity(before, _corridor(step[1] + 0.4, step[2] + 0.2), move) is Continuity.BROKEN


def test_something_new_in_a_third_of_the_scan_is_no_break_and_two_scans_without_common_beams_cannot_tell():
    before, after = _corridor(0.0, 0.0), _corridor(0.0, 0.0)
    ranges = after.ranges_m.copy()
    ranges[:34] = 0.7  # somebody steps in from the right
    assert scan_continuity(before, replace(after, ranges_m=ranges), np.eye(4)) is not Continuity.BROKEN
    assert scan_continuity(before, after, se2(0.0, 0.0, 1.5)) is Continuity.UNKNOWN
    assert scan_continuity(None, after, np.eye(4)) is Continuity.UNKNOWN


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.5, 4.0])
def test_few_key_points_found_again_tell_that_a_view_goes_on_and_none_found_tells_nothing(angle):
    """In a hall most key-points lie further than the camera measures."""
    before, after, across = (look(_round(a)) for a in (angle, angle + 0.1, angle + 3.1))
    step = inverse(_round(angle)) @ _round(angle + 0.1)
    last = features(before, FEATURES)
    points = np.where(np.arange(len(last.points))[:, None] % (len(last.points) // 18) == 0, last.points, np.nan)
    few = replace(last, points=points)
    assert continuity(few, features(after, FEATURES), before.camera, step) is Continuity.GOES_ON
    assert continuity(few, features(across, FEATURES), before.camera, step) is Continuity.UNKNOWN
