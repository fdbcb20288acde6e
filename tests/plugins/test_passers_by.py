"""Beams that meet somebody who walks, in a room of which every range can be computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import inverse, se2
from rhs.api.records import Motion, Scan, Tracking
from rhs_localisers.advanced import PassersSettings
from rhs_localisers.passers_by import PassersBy

BEARINGS = np.radians(np.arange(-135.0, 135.5, 0.5))
HALF_M = np.array([5.0, 4.0])  # of the room, whose middle is the origin
WIDE_M = 0.25  # radius of who walks there


def scan_from(pose, people=()):
    """The room and round people (x, y) seen from a pose (3,)."""
    along = np.stack([np.cos(BEARINGS + pose[2]), np.sin(BEARINGS + pose[2])], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = ((np.sign(along) * HALF_M - pose[:2]) / along)
    ranges = np.nanmin(walls, axis=1)
    for person in people:
        towards = np.asarray(person) - pose[:2]
        ahead, aside = along @ towards, along @ [[0.0, 1.0], [-1.0, 0.0]] @ towards
        met = ahead - np.sqrt(np.maximum(WIDE_M**2 - aside**2, 0.0))
        ranges = np.where((np.abs(aside) < WIDE_M) & (met > 0.0), np.minimum(ranges, met), ranges)
    return Scan(BEARINGS, ranges, 30.0)


def led(poses, people, *, settings=None, told=None):
    """Scans with and without passers-by of a robot led along poses, 0.25 s apart; people: one list for each. told: the
    motion of the odometry in place of the true one."""
    part, out = PassersBy(settings or PassersSettings()), []
    for k, (pose, there) in enumerate(zip(poses, people, strict=True)):
        moved = inverse(se2(*poses[k - 1])) @ se2(*pose) if k else np.eye(4)
        motion = Motion(moved if told is None else told, 1e-6 * np.eye(6), Tracking.OK)
        scan = scan_from(np.asarray(pose), there)
        out.append((scan, part.without(scan, motion, 0.25 * k)))
    return out


WAY = [(-3.0 + 0.1 * k, 0.3 * np.sin(0.2 * k), 0.4 * np.sin(0.3 * k)) for k in range(40)]


def gone(pair):
    return np.isfinite(pair[0].ranges_m) & np.isnan(pair[1].ranges_m)


def test_walls_and_what_always_stood_there_are_never_taken_for_somebody():
    for people in ((), ((1.0, 1.5), (2.0, -2.0))):
        assert not any(gone(pair).any() for pair in led(WAY, [people] * len(WAY)))


def test_who_walks_past_is_left_out_and_the_walls_stay():
    people = [[(2.5, -3.0 + 0.25 * k)] for k in range(24)]  # 1 m/s
    seen = led(WAY[:24], people)
    for pose, pair in list(zip(WAY, seen, strict=False))[4:]:
        somebody = pair[0].ranges_m < scan_from(np.asarray(pose)).ranges_m - 0.5
        assert somebody.sum() > 5
        assert gone(pair)[somebody].mean() > 0.7
        assert gone(pair)[~somebody].mean() < 0.01


def test_who_stays_is_a_thing_again_after_some_seconds():
    people = [[]] * 10 + [[(2.0, 0.0)]] * 30
    seen = led([(0.0, 0.0, 0.0)] * 40, people)
    assert gone(seen[10]).sum() > 10 and gone(seen[20]).sum() > 10
    assert not gone(seen[39]).any()


def test_where_most_would_be_gone_the_motion_is_wrong_and_the_scan_is_believed():
    stands, wrong = [(0.0, 0.0, 0.0)] * 6, se2(-1.5, 0.0, 0.0)
    found = max(gone(pair).mean() for pair in led(stands, [()] * 6, told=wrong, settings=PassersSettings(most=1.0)))
    assert found > 0.2
    believed = led(stands, [()] * 6, told=wrong, settings=PassersSettings(most=0.9 * found))
    assert max(gone(pair).mean() for pair in believed) < 0.9 * found


def test_beams_without_an_end_say_nothing_and_break_nothing():
    part = PassersBy(PassersSettings())
    motion = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
    nothing = Scan(BEARINGS, np.full(len(BEARINGS), np.inf), 30.0)
    with np.errstate(all="raise"):
        for k in range(5):
            assert part.without(nothing, motion, 0.3 * k) is nothing


@pytest.mark.parametrize("wrong", [{"back_s": -1.0}, {"most": 2.0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(Exception, match="back_s|most"):
        PassersSettings(**wrong)
