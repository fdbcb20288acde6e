"""Closing a drifted lap of the painted room."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import context, ring, survey

from rhs.api.geometry import exp_se3, inverse, log_se3, se2
from rhs.api.records import LoopEdge
from rhs.estimation.filters.pose_graph import Edges, chain, joined, optimise
from rhs.estimation.views.edge_consistency import DriftBounds, agreement, largest_agreeing, supported, surprise
from rhs.estimation.views.loops import travelled_m
from rhs_loop_closers.config import ErrorDistribution, PoseGraph, PoseGraphAdvanced
from rhs_loop_closers.pose_graph import Between, level_edges

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


def test_only_the_closure_that_is_used_counts_as_taken():
    views = survey(TRUTH, drift=se2(0.01, 0.004, 0.01))
    edges = ErrorDistribution().build(context()).close(views).edges
    assert [edge.accepted for edge in edges] == [True] + [False] * (len(edges) - 1) and len(edges) > 1
    assert all("not used" in edge.reason for edge in edges[1:])


def test_a_loop_that_turns_a_view_further_than_an_odometry_can_is_refused():
    """Fourteen degrees after five metres: no odometry; after a whole lap of turning on the spot it may be."""
    closer = PoseGraph().build(context())
    straight = np.stack([se2(0.25 * k, 0.0, 0.0) for k in range(21)])
    spun = np.stack([se2(0.0, 0.0, np.radians(18.0 * k)) for k in range(21)])
    turned = se2(5.0, 0.0, np.radians(14.0))
    refused = closer._plausible(LoopEdge(0, 20, turned, np.eye(6), 30), straight, travelled_m(straight))
    assert not refused.accepted and "turns the later view by 14 degrees" in refused.reason
    assert closer._plausible(LoopEdge(0, 20, se2(5.1, 0.0, 0.1), np.eye(6), 30), straight, travelled_m(straight)).accepted
    back = LoopEdge(0, 20, se2(0.0, 0.0, np.radians(14.0)), np.eye(6), 30)
    assert closer._plausible(back, spun, travelled_m(spun)).accepted


def test_two_views_or_none_do_not_break_it():
    closer = ErrorDistribution().build(context())
    assert closer.close([]).poses.shape == (0, 4, 4)
    assert closer.close(survey(TRUTH[:2])).poses.shape == (2, 4, 4)


def test_travelled_adds_up():
    np.testing.assert_allclose(travelled_m(np.stack([se2(0, 0, 0), se2(3, 4, 1), se2(3, 5, 1)])), [0, 5, 6])


def _ate_m(poses, truth):
    return float(np.sqrt(np.mean([np.linalg.norm(p[:3, 3] - t[:3, 3]) ** 2 for p, t in zip(poses, truth, strict=True)])))


def test_pose_graph_halves_the_error_of_a_lap_and_a_half_and_more():
    truth = ring(36, turns=1.5)
    views = survey(truth, drift=se2(0.01, 0.004, 0.01))
    closure = PoseGraph().build(context()).close(views)
    assert closure.details["closures"] >= 5
    assert _ate_m(closure.poses, truth) < 0.3 * _ate_m([view.map_from_body for view in views], truth)
    np.testing.assert_array_equal(closure.poses[0], views[0].map_from_body)


def test_a_survey_whose_graph_has_few_nodes_is_closed_as_one_whose_views_all_are():
    """Every seventh view of a lap and a half, and the ends of its loops; both move it by half a metre, to a millimetre."""
    views = survey(ring(36, turns=1.5), drift=se2(0.01, 0.004, 0.01))
    every, few = (PoseGraph(advanced=PoseGraphAdvanced(most_poses=most)).build(context()).close(views) for most in (37, 6))
    moved = every.poses - [view.map_from_body for view in views]
    assert np.linalg.norm(moved[:, :3, 3], axis=1).max() > 0.5
    np.testing.assert_allclose(few.poses[:, :3, 3], every.poses[:, :3, 3], atol=0.002)
    assert few.details == every.details


def test_a_loop_that_errs_in_height_and_tilt_lifts_no_robot_off_its_floor():
    """Out and back along a line by an odometry that is unsure; the loop at its end says 0.2 m lower and 3 degrees down."""
    poses = np.stack([se2(0.3 * k, 0.0, 0.0) for k in range(20)] + [se2(0.3 * k, 0.0, np.pi) for k in range(19, -1, -1)])
    wrong = poses[-1] @ exp_se3(np.array([0.0, 0.0, -0.2, 0.0, 0.05, 0.0]))
    unsure = chain(poses, np.tile(1e-3 * np.eye(6), (39, 1, 1)))
    loop = Edges(np.array([0]), np.array([39]), wrong[None], 4e-4 * np.eye(6)[None], np.zeros(1, bool))
    free = optimise(poses, joined(unsure, loop)).poses
    held = optimise(poses, joined(joined(unsure, level_edges(poses, PoseGraphAdvanced())), loop)).poses
    assert np.abs(free[:, 2, 3]).mean() > 0.04 and np.abs(held[:, 2, 3]).mean() < 0.01
    np.testing.assert_allclose(held[:, :2, 3], poses[:, :2, 3], atol=0.01)


def test_loops_that_share_the_depths_of_one_eye_know_no_more_together_than_one():
    """Five loops of neighbouring views pull the end of a line aside as far as one does; of measured depths twice as far."""
    straight = np.stack([se2(0.25 * k, 0.0, 0.0) for k in range(41)])
    between = Between(straight, np.tile(1e-4 * np.eye(6), (40, 1, 1)), level=False, walls=None)
    loops = [LoopEdge(0, 40 - k, se2(10.0 - 0.25 * k, 0.5, 0.0), 0.2 * np.eye(6), 30) for k in range(5)]
    aside_m = {}
    for share in (0.0, 0.06):
        closer = PoseGraph(advanced=PoseGraphAdvanced(depth_share=share)).build(context())
        aside_m[share] = [closer._optimised(some, straight, between).poses[-1, 1, 3] for some in (loops[:1], loops)]
    assert aside_m[0.06][1] == pytest.approx(aside_m[0.06][0], rel=0.01)
    assert aside_m[0.0][0] == pytest.approx(aside_m[0.06][0]) and aside_m[0.0][1] > 2.0 * aside_m[0.0][0]


def test_a_loop_is_as_surprising_as_what_it_and_the_odometry_state():
    """Four degrees are 4 sigmas after four steps of half a degree on the spot, and 1 after 64. 10 m after a turn known to
    0.01 rad, 2 sigmas of it are 0.02 rad and 0.2 m aside; 0.2 m aside and straight ahead is past belief."""
    sure, turned = 1e-10 * np.eye(6), se2(0.0, 0.0, np.radians(4.0))
    spot = np.tile(np.eye(4), (65, 1, 1))
    half = np.tile(sure + np.diag([0, 0, 0, 0, 0, np.radians(0.5) ** 2]), (64, 1, 1))
    edges = [LoopEdge(0, later, turned, sure, 30) for later in (4, 64)]
    np.testing.assert_allclose(surprise(edges, spot, half), [16.0, 1.0], rtol=1e-4)
    line = np.stack([se2(0.0, 0.0, 0.0)] + [se2(1.0 * k, 0.0, 0.0) for k in range(11)])
    first = np.concatenate([(sure + np.diag([0, 0, 0, 0, 0, 1e-4]))[None], np.tile(sure, (10, 1, 1))])
    swung, pushed = (LoopEdge(0, 11, se2(10.0, 0.2, yaw), 1e-5 * np.eye(6), 30) for yaw in (0.02, 0.0))
    assert surprise([swung], line, first)[0] == pytest.approx(4.0, rel=0.05)
    assert surprise([pushed], line, first)[0] > 10.0
    asked = PoseGraph(advanced=PoseGraphAdvanced(odometry_probability=0.99)).build(context())
    assert "4.0 sigmas" in asked._likely(edges, spot, half)[0].reason and asked._likely(edges, spot, half)[1].accepted


def test_the_closure_says_how_unsure_its_poses_are():
    """A lap that comes back is least sure halfway round; half of it, which closes no loop, at its end."""
    lap, half = (PoseGraph().build(context()).close(survey(ring(24, turns))) for turns in (1.0, 0.5))
    of_lap, of_half = (np.sqrt(closure.covariances[:, 0, 0] + closure.covariances[:, 1, 1]) for closure in (lap, half))
    assert of_lap[-1] < 0.5 * of_lap[12] and of_half[-1] == of_half.max() > of_lap[-1]


def test_pose_graph_refuses_a_planted_lie_with_a_reason():
    truth = ring(36, turns=1.5)
    views = survey(truth, drift=se2(0.01, 0.004, 0.01))
    views[30] = replace(views[30], features=views[10].features)  # view 30 pretends to be view 10
    closure = PoseGraph().build(context()).close(views)
    for edge in closure.edges:
        if edge.later == 30 or edge.earlier == 30:
            assert not edge.accepted and edge.reason
    assert _ate_m(closure.poses, truth) < 0.3 * _ate_m([view.map_from_body for view in views], truth)


def test_pose_graph_without_loops_changes_nothing():
    views = survey(TRUTH[:10], drift=se2(0.01, 0.0, 0.0))
    closure = PoseGraph().build(context()).close(views)
    np.testing.assert_array_equal(closure.poses, [view.map_from_body for view in views])
    assert PoseGraph().build(context()).close([]).poses.shape == (0, 4, 4)
    assert PoseGraph().build(context()).close(survey(TRUTH[:1])).poses.shape == (1, 4, 4)


def test_two_crowds_of_loops_that_contradict_each_other_are_not_mixed():
    poses = np.stack([se2(0.5 * k, 0.0, 0.0) for k in range(60)])
    way_m = travelled_m(poses)

    def edge(i, j, x_m):
        return LoopEdge(i, j, se2(x_m, 0.0, 0.0), np.eye(6), 30)

    true = [edge(k, 50 + k, 0.5 * 50) for k in range(5)]
    false = [edge(k, 50 + k, 0.5 * 50 + 3.0) for k in range(3)]
    agree = agreement(true + false, poses, way_m, DriftBounds())
    assert largest_agreeing(agree, np.ones(8)).tolist() == [0, 1, 2, 3, 4]


def test_a_lonely_edge_has_no_support():
    way_m = np.arange(60.0)
    edges = [LoopEdge(i, j, np.eye(4), np.eye(6), 30) for i, j in ((0, 40), (1, 41), (2, 42), (20, 55))]
    assert supported(edges, way_m, 3.0).tolist() == [3, 3, 3, 1]


def in_a_hand(views):
    """The same views of a camera that stands on no floor."""
    mount = views[0].camera.body_from_camera.copy()
    mount[2, 3] = 0.0
    hand = replace(views[0].camera, body_from_camera=mount)
    assert hand.height_m == 0.0
    return [replace(view, camera=hand) for view in views]


def test_loops_that_an_odometry_in_a_hand_bears_out_confirm_it_and_move_nothing():
    views = in_a_hand(survey(TRUTH))
    closure = PoseGraph(support=1).build(context()).close(views)
    assert closure.details["closures"] > 0
    np.testing.assert_array_equal(closure.poses, [view.map_from_body for view in views])


def test_loops_that_it_contradicts_put_a_hand_right():
    views = in_a_hand(survey(TRUTH, drift=se2(0.01, 0.004, 0.01)))
    closure = PoseGraph(support=1).build(context()).close(views)
    assert closure.details["closures"] > 0 and _end_error_m(closure.poses) < 0.1


def test_two_loops_that_agree_on_the_floor_alone_contradict_each_other_in_a_hand():
    poses, way_m = np.array(TRUTH), travelled_m(np.array(TRUTH))
    true = LoopEdge(0, 24, inverse(poses[0]) @ poses[24], np.eye(6), 30)
    lifted = replace(true, earlier=1, earlier_from_later=inverse(poses[1]) @ poses[24])
    lifted.earlier_from_later[2, 3] += 1.0
    assert agreement([true, lifted], poses, way_m, DriftBounds()).all()
    assert not agreement([true, lifted], poses, way_m, DriftBounds(), solid=True)[0, 1]
