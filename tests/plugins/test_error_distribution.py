"""Eq. 3.14 on loops one can compute by hand."""

from dataclasses import replace

import numpy as np
from painted_survey import ring, survey

from rhs.api.geometry import inverse, planar, se2
from rhs.api.records import LoopEdge
from rhs_loop_closers.config import NoClosing
from rhs_loop_closers.error_distribution import bridged, spread


def _edge(earlier, later, earlier_from_later):
    return LoopEdge(earlier, later, earlier_from_later, np.eye(6) * 1e-4, 50)


def test_the_end_lands_where_the_loop_says_and_the_start_stays():
    poses = np.stack([se2(x, 0.0, 0.0) for x in range(11)])
    wanted = se2(10.5, 0.4, 0.1)
    out = spread(poses, _edge(0, 10, wanted))
    np.testing.assert_array_equal(out[0], poses[0])
    np.testing.assert_allclose(out[-1], wanted, atol=1e-9)


def test_each_axis_is_corrected_by_the_share_of_its_own_way():
    # 4 m along x, then 6 m along y: the error in x is all spread over the first leg, that in y over the second.
    corners = [(x, 0.0) for x in range(5)] + [(4.0, y) for y in range(1, 7)]
    poses = np.stack([se2(x, y, 0.0) for x, y in corners])
    out = spread(poses, _edge(0, 10, se2(4.4, 6.6, 0.0)))
    shift = out[:, :2, 3] - poses[:, :2, 3]
    np.testing.assert_allclose(shift[:, 0], [0, 0.1, 0.2, 0.3, 0.4] + [0.4] * 6, atol=1e-12)
    np.testing.assert_allclose(shift[:, 1], [0] * 5 + [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], atol=1e-12)


def test_there_and_back_counts_as_way_in_both_directions():
    poses = np.stack([se2(x, 0.0, 0.0) for x in (0.0, 1.0, 2.0, 1.0, 0.0)])
    out = spread(poses, _edge(0, 4, se2(0.4, 0.0, 0.0)))
    np.testing.assert_allclose(out[:, 0, 3], [0.0, 1.1, 2.2, 1.3, 0.4], atol=1e-12)


def test_a_yaw_error_is_spread_over_the_turns_even_past_half_a_turn():
    yaws = np.linspace(0.0, 2 * np.pi, 41)  # once round on the spot, with steps
    poses = np.stack([se2(0.01 * k, 0.0, yaw) for k, yaw in enumerate(yaws)])
    out = spread(poses, _edge(0, 40, se2(0.4, 0.0, 0.2)))
    turned = np.unwrap([planar(pose)[2] for pose in out])
    np.testing.assert_allclose(turned, yaws * (1 + 0.2 / (2 * np.pi)), atol=1e-9)


def test_height_that_never_changed_is_spread_by_distance():
    poses = np.stack([se2(x, 0.0, 0.0) for x in range(5)])
    wanted = se2(4.0, 0.0, 0.0)
    wanted[2, 3] = 0.8
    np.testing.assert_allclose(spread(poses, _edge(0, 4, wanted))[:, 2, 3], [0, 0.2, 0.4, 0.6, 0.8], atol=1e-12)


def test_before_the_loop_nothing_moves_and_after_it_all_moves_with_the_end():
    poses = np.stack([se2(x, 0.0, 0.0) for x in range(8)])
    out = spread(poses, _edge(2, 5, se2(3.0, 0.3, 0.1)))
    np.testing.assert_array_equal(out[:3], poses[:3])
    for k in (6, 7):
        np.testing.assert_allclose(inverse(out[5]) @ out[k], inverse(poses[5]) @ poses[k], atol=1e-12)


def test_without_a_closer_the_poses_are_returned_as_they_are_and_as_unsure():
    assert NoClosing().build(None).close([]).poses.shape == (0, 4, 4)
    views = [replace(view, covariance=(k + 1.0) * np.eye(6)) for k, view in enumerate(survey(ring(5)))]
    closure = NoClosing().build(None).close(views)
    np.testing.assert_array_equal(closure.poses[3], views[3].map_from_body)
    np.testing.assert_array_equal(closure.covariances[:, 0, 0], [1, 2, 3, 4, 5, 6])


def test_a_loop_leaves_a_bridge_of_what_its_poses_were_unsure_by():
    """Way 0 to 10 m, a variance of 1 a metre: nothing at the loop's ends, most half way, what is added after it."""
    way_m = np.arange(11.0)
    unsure = way_m[:, None, None] * np.eye(6)
    out = bridged(unsure, way_m, _edge(0, 8, se2(8.0, 0.0, 0.0)))
    np.testing.assert_allclose(out[:, 0, 0], [0, 7 / 8, 12 / 8, 15 / 8, 16 / 8, 15 / 8, 12 / 8, 7 / 8, 0, 1, 2])
    later = bridged(unsure, way_m, _edge(2, 8, se2(6.0, 0.0, 0.0)))[:, 0, 0]  # a loop that ends beside an unsure view
    np.testing.assert_allclose(later[[0, 1, 8]], [0, 1, 2])


def test_turned_undoes_an_error_of_heading_made_in_one_corner_and_printed_does_not():
    # Two sides of 5 m; the corner was measured 0.2 rad too small, nothing else is wrong.
    def walk(corner_rad):
        steps = [se2(1.0, 0.0, 0.0)] * 5 + [se2(0.0, 0.0, corner_rad)] + [se2(1.0, 0.0, 0.0)] * 5
        poses = [np.eye(4)]
        for step in steps:
            poses.append(poses[-1] @ step)
        return np.stack(poses)

    truth, believed = walk(np.pi / 2), walk(np.pi / 2 - 0.2)
    edge = _edge(0, 11, truth[-1])
    np.testing.assert_allclose(spread(believed, edge, turned=True), truth, atol=1e-9)
    left = np.linalg.norm(spread(believed, edge)[:, :2, 3] - truth[:, :2, 3], axis=1).max()
    assert left > 0.2
