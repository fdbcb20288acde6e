"""The loop closer of laser scans on hand-made corridors that come back to where they began."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from laser_rooms import box, drive, observed, true_wheels, views_of

from rhs.api.records import Motion, Tracking
from rhs.estimation.scans.inconsistency import map_inconsistency
from rhs.estimation.scans.planar_poses import between, composed, flat
from rhs_loop_closers.scan_graph.config import ScanGraph

# a square of corridors 2 m wide, 16 m a side, with niches so that no two stretches are alike
WALLS = np.concatenate([box(0, 0, 16, 16), box(2, 2, 14, 14), box(5, 1.7, 5.6, 2), box(9, 0, 10, 0.3), box(15.6, 4, 16, 5),
                        box(13.7, 9, 14, 9.5), box(6, 15.7, 6.5, 16), box(10, 13.8, 11, 14), box(0, 9, 0.4, 9.8),
                        box(1.8, 4, 2, 5.2)])
WAY = drive([(1, 1), (15, 1), (15, 15), (1, 15), (1, 1), (15, 1), (15, 6)], step_m=0.2, step_rad=0.2)


@cache
def survey(turn_rad=0.0007):
    """Views whose odometry turns too far by so much in every step."""
    observations = observed(WALLS, WAY)
    steps = true_wheels(WAY) + [0.0, 0.0, turn_rad]
    believed = [WAY[0]]
    for step in steps[1:]:
        believed.append(composed(believed[-1], step))
    motion = Motion(np.eye(4), np.diag([0.02, 0.02, 1e-3, 1e-3, 1e-3, 0.01]) ** 2, Tracking.OK)
    return views_of(observations, [motion] * len(observations), np.array(believed))


def error_m(poses):
    """Largest distance from the truth, the start made to agree."""
    states = flat(poses)
    off = between(np.tile(states[0], (len(states), 1)), states) - between(np.tile(WAY[0], (len(WAY), 1)), WAY)
    return float(np.hypot(off[:, 0], off[:, 1]).max())


def test_a_round_that_ends_metres_off_is_closed():
    views = survey()
    before = error_m(np.array([view.map_from_body for view in views]))
    closure = ScanGraph().build(None).close(views)
    assert before > 2.0
    assert error_m(closure.poses) < 0.25
    accepted = [edge for edge in closure.edges if edge.accepted]
    assert accepted
    for edge in accepted:
        off = between(between(WAY[edge.earlier], WAY[edge.later]), flat(edge.earlier_from_later[None])[0])
        assert np.hypot(*off[:2]) < 0.15 and abs(off[2]) < 0.05


def test_the_map_says_itself_which_way_is_wrong():
    """Walls of the second lap stand where the first one drove, until the loop is closed."""
    views = survey()
    scans = [view.scan for view in views]
    wrong = map_inconsistency(scans, flat(np.array([view.map_from_body for view in views])))
    right = map_inconsistency(scans, WAY)
    assert right < 0.03 and wrong > 0.1


def test_people_are_no_walls_that_others_look_through():
    """Somebody who walks along is in every scan and nowhere in the next ones."""
    rng = np.random.default_rng(1)
    scans = []
    for view in survey(0.0):
        ranges = np.array(view.scan.ranges_m)
        at = int(rng.integers(20, 150))
        ranges[at : at + 12] = np.minimum(ranges[at : at + 12], rng.uniform(0.4, 0.6))
        scans.append(replace(view.scan, ranges_m=ranges))
    assert map_inconsistency(scans, WAY) < 0.01


def test_along_a_corridor_without_ends_the_way_is_unsure():
    """60 m of two walls: the wheels alone say how far it was, by a tenth of each 0.3 m and 2 cm."""
    way = drive([(0, 0), (60, 0)])
    observations = observed(np.array([[[-100, -1], [200, -1]], [[-100, 1], [200, 1]]], float), way)
    motion = Motion(np.eye(4), np.diag([0.02, 0.02, 1e-3, 1e-3, 1e-3, 0.01]) ** 2, Tracking.OK)
    closure = ScanGraph().build(None).close(views_of(observations, [motion] * len(way), way))
    step_m = 0.02 + 0.1 * 0.45  # key scans are every third of 0.15 m
    expected_m = step_m * np.sqrt(0.5 * 60.0 / 0.45)  # a random walk, rms along the way
    assert 0.7 * expected_m < closure.details["way_sigma_m"] < 1.4 * expected_m
    along_m, across_m = np.sqrt(closure.covariances[:, [0, 1], [0, 1]]).T
    said = np.isfinite(along_m)
    assert said[0] and 50 <= said.sum() <= 61 and np.all(np.diff(along_m[said]) > 0.0)
    assert along_m[said][-1] == pytest.approx(step_m * np.sqrt(60.0 / 0.45), rel=0.3) and np.all(across_m[said] < 0.5)


def test_where_no_place_is_seen_twice_nothing_is_said_and_nothing_moves_far():
    views = survey(0.0)[:60]
    closure = ScanGraph().build(None).close(views)
    assert not any(edge.accepted for edge in closure.edges)
    assert np.isnan(map_inconsistency([view.scan for view in views], WAY[:60]))
    shift = np.linalg.norm(closure.poses[:, :2, 3] - np.array([v.map_from_body for v in views])[:, :2, 3], axis=1)
    assert shift.max() < 0.05


def test_corridors_side_by_side_are_not_laid_onto_one_another():
    """Five lanes 1 m wide with walls of 0.2 m between, driven there and back by an odometry that makes no error."""
    walls = np.concatenate([box(0, 0, 4, 5.8), *(box(0, y, 3, y + 0.2) for y in (1.0, 3.4)),
                            *(box(1, y, 4, y + 0.2) for y in (2.2, 4.6))])
    lanes = [corner for y in (0.5, 2.9, 5.3) for corner in ((0.5, y), (3.5, y), (3.5, y + 1.2), (0.5, y + 1.2))][:-2]
    way = drive([*lanes, *lanes[-2::-1]])
    motion = Motion(np.eye(4), 1e-4 * np.eye(6), Tracking.OK)
    views = views_of(observed(walls, way), [motion] * len(way), way)
    closed = ScanGraph().build(None).close(views)
    assert np.hypot(*(flat(closed.poses) - way)[:, :2].T).max() < 0.05
