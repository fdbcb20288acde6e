"""Closing a drifted lap of the painted room."""

import numpy as np
from painted_survey import context, ring, survey

from rhs.geometry import inverse, log_se3, se2
from rhs.loops import travelled_m
from rhs_loop_closers.error_distribution_config import ErrorDistribution

TRUTH = ring(24)


def _end_error_m(poses):
    return float(np.linalg.norm(log_se3(inverse(TRUTH[-1]) @ poses[-1])[:3]))


def test_the_end_is_found_in_the_beginning_and_its_error_goes_away():
    views = survey(TRUTH, drift=se2(0.01, 0.004, 0.01))
    before = _end_error_m([view.map_from_body for view in views])
    closure = ErrorDistribution().build(context()).close(views)
    assert before > 0.2
    assert _end_error_m(closure.poses) < 0.1 * before
    np.testing.assert_array_equal(closure.poses[0], views[0].map_from_body)
    assert len(closure.poses) == len(views)
    assert closure.edges[0].accepted


def test_views_without_keypoints_in_between_are_corrected_too():
    views = survey(TRUTH, drift=se2(0.01, 0.004, 0.01), every=3)
    closure = ErrorDistribution().build(context()).close(views)
    assert len(closure.poses) == 25 and _end_error_m(closure.poses) < 0.03


def test_a_way_that_never_comes_back_is_left_alone():
    views = survey(TRUTH[:10], drift=se2(0.01, 0.0, 0.0))
    closure = ErrorDistribution(reach_views=2).build(context()).close(views)
    np.testing.assert_array_equal(closure.poses, [view.map_from_body for view in views])


def test_a_closure_no_odometry_could_have_earned_is_refused_with_the_reason():
    views = survey(TRUTH, drift=se2(0.0, 0.0, 0.02))
    closure = ErrorDistribution(max_drift_share=0.0).build(context()).close(views)
    assert closure.edges and not any(edge.accepted for edge in closure.edges)
    assert "m of way" in closure.edges[0].reason
    np.testing.assert_array_equal(closure.poses[-1], views[-1].map_from_body)


def test_two_views_or_none_do_not_break_it():
    closer = ErrorDistribution().build(context())
    assert closer.close([]).poses.shape == (0, 4, 4)
    assert closer.close(survey(TRUTH[:2])).poses.shape == (2, 4, 4)


def test_travelled_adds_up():
    np.testing.assert_allclose(travelled_m(np.stack([se2(0, 0, 0), se2(3, 4, 1), se2(3, 5, 1)])), [0, 5, 6])
