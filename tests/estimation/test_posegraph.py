"""The pose graph on loops with known answers, and against gtsam."""

import time

import numpy as np
import pytest

from rhs.api.geometry import exp_se3, inverse, log_se3, planar, se2
from rhs.estimation.filters.pose_graph import CommonScale, Edges, chain, exp_poses, joined, log_poses, marginals, optimise


def _covariances(count, sigma_m=0.01, sigma_rad=0.005):
    return np.tile(np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 3), (count, 1, 1))


def _loop_edge(i, j, measured, sigma=0.01, robust=True):
    return Edges(np.array([i]), np.array([j]), measured[None], _covariances(1, sigma, sigma), np.array([robust]))


def _noisy_square(rng, per_side=25, step=0.2):
    """True poses once round a square, and the same with noise on every step."""
    moves = ([se2(step, 0, 0)] * per_side + [se2(0, 0, np.pi / 2)]) * 4
    truth, believed = [np.eye(4)], [np.eye(4)]
    for move in moves:
        truth.append(truth[-1] @ move)
        noise = np.array([0.005, 0.005, 0.001, 0.0003, 0.0003, 0.004]) * rng.normal(size=6)
        believed.append(believed[-1] @ move @ exp_se3(noise + [0.002, 0, 0, 0, 0, 0.001]))
    return np.stack(truth), np.stack(believed)


def _ate(poses, truth):
    return float(np.sqrt(((poses[:, :3, 3] - truth[:, :3, 3]) ** 2).sum(axis=1).mean()))


def test_a_chain_with_one_loop_spreads_the_gap_evenly():
    poses = np.stack([se2(x, 0, 0) for x in range(11)])
    loop = _loop_edge(0, 10, se2(11.1, 0, 0), sigma=1e-5, robust=False)
    edges = joined(chain(poses, _covariances(10)), loop)
    found = optimise(poses, edges).poses
    np.testing.assert_allclose(found[:, 0, 3], 1.11 * np.arange(11), atol=1e-4)
    np.testing.assert_array_equal(found[0], poses[0])


def test_three_measurements_of_one_pose_give_their_weighted_mean():
    edges = [_loop_edge(0, 1, se2(x, 0, 0), sigma=s, robust=False) for x, s in ((1.0, 0.1), (2.0, 0.1), (4.0, 0.2))]
    graph = joined(joined(edges[0], edges[1]), edges[2])
    found = optimise(np.stack([np.eye(4), np.eye(4)]), graph).poses
    weights = np.array([1 / 0.01, 1 / 0.01, 1 / 0.04])
    assert found[1, 0, 3] == pytest.approx(weights @ [1.0, 2.0, 4.0] / weights.sum(), abs=1e-8)


def test_a_noisy_square_closes_and_comes_nearer_to_the_truth():
    truth, believed = _noisy_square(np.random.default_rng(3))
    edges = joined(chain(believed, _covariances(len(believed) - 1)), _loop_edge(0, len(truth) - 1, truth[-1]))
    found = optimise(believed, edges)
    assert _ate(found.poses, truth) < 0.4 * _ate(believed, truth)
    assert np.linalg.norm(log_se3(inverse(truth[-1]) @ found.poses[-1])) < 0.02


def test_metres_that_are_all_too_short_are_found_out():
    """Ten steps of one metre each, measured as 0.97 m, and the end known to be 10 m off: every metre is 1 / 0.97 long, the
    ways between are stretched evenly, and with a sigma of nothing the steps take the blame instead."""
    poses = np.stack([se2(0.97 * x, 0, 0) @ se2(0, 0, 0.2 * (x > 4)) for x in range(11)])
    steps = chain(poses, _covariances(10))
    ends = _loop_edge(0, 10, poses[-1] @ se2(0, 0, 0), sigma=1e-5, robust=False)
    ends.from_from_to[0, :3, 3] /= 0.97
    graph = joined(steps, ends)
    chosen = np.arange(11) < 10
    found = optimise(poses, graph, scale=CommonScale(chosen, 10.0))
    assert found.share == pytest.approx(1 / 0.97 - 1.0, abs=1e-4)
    np.testing.assert_allclose(found.poses[:, :3, 3], poses[:, :3, 3] / 0.97, atol=1e-3)
    assert found.chi2.max() < 1e-3
    blamed = optimise(poses, graph, scale=CommonScale(chosen, 1e-6))
    assert abs(blamed.share) < 1e-6 and blamed.chi2.max() > 1.0
    assert optimise(poses, graph).share == 0.0


def test_what_is_unsure_adds_up_along_the_way_and_is_least_where_a_loop_closes():
    """Ten steps of 1 m, 1 cm each: the end is unsure by sqrt(10) cm. A loop of 1e-4 m from start to end leaves the middle
    sqrt(5 * 5 / 10) cm (a Brownian bridge). Metres that may all be 1 % too short add 10 cm to the end, along the way."""
    poses = np.stack([se2(x, 0, 0) for x in range(11)])
    steps = chain(poses, _covariances(10, sigma_rad=1e-6))
    assert marginals(poses, steps, np.array([10]))[0, 0, 0] == pytest.approx(10 * 1e-4, rel=1e-3)
    held = joined(steps, _loop_edge(0, 10, poses[-1], sigma=1e-4, robust=False))
    middle, end = marginals(poses, held, np.array([5, 10]))[:, 0, 0]
    assert middle == pytest.approx(2.5e-4, rel=1e-3) and end == pytest.approx(1e-8, rel=1e-2)
    short = CommonScale(np.ones(10, bool), 0.01)
    along, across = np.diag(marginals(poses, steps, np.array([10]), scale=short)[0])[:2]
    assert along == pytest.approx(10 * 1e-4 + 0.1**2, rel=1e-3) and across == pytest.approx(10 * 1e-4, rel=1e-3)


def test_a_false_loop_is_outvoted_by_the_kernel_and_shown_by_its_chi2():
    truth, believed = _noisy_square(np.random.default_rng(4))
    last = len(truth) - 1
    graph = chain(believed, _covariances(last))
    for i, j in ((0, last), (1, last - 1), (2, last - 2)):
        graph = joined(graph, _loop_edge(i, j, inverse(truth[i]) @ truth[j]))
    clean = optimise(believed, graph).poses
    bent = optimise(believed, joined(graph, _loop_edge(0, 52, se2(0.3, 0, 0))))
    assert _ate(bent.poses, clean) < 0.1
    assert bent.chi2[-1] > 1000 > bent.chi2[-4:-1].max()


def test_logs_and_exponentials_of_many_poses_agree_with_those_of_one():
    rng = np.random.default_rng(0)
    twists = rng.normal(size=(20, 6)) * np.logspace(-6, 0.2, 20)[:, None]
    poses = exp_poses(twists)
    np.testing.assert_allclose(poses, [exp_se3(t) for t in twists], atol=1e-9)
    np.testing.assert_allclose(log_poses(poses), twists, atol=1e-9)


def test_gtsam_finds_the_same_poses():
    gtsam = pytest.importorskip("gtsam", reason="gtsam is not installed; it is only a second opinion")
    truth, believed = _noisy_square(np.random.default_rng(5), per_side=10)
    last = len(truth) - 1
    edges = joined(chain(believed, _covariances(last)), _loop_edge(0, last, truth[-1], robust=False))
    ours = optimise(believed, edges).poses
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(believed[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-9)))
    swap = np.eye(6)[[3, 4, 5, 0, 1, 2]]  # gtsam puts the rotation first
    for i, j, z, c in zip(edges.from_at, edges.to_at, edges.from_from_to, edges.covariances, strict=True):
        noise = gtsam.noiseModel.Gaussian.Covariance(swap @ c @ swap.T)
        graph.add(gtsam.BetweenFactorPose3(int(i), int(j), gtsam.Pose3(z), noise))
    for k, pose in enumerate(believed):
        values.insert(k, gtsam.Pose3(pose))
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    theirs = np.stack([result.atPose3(k).matrix() for k in range(len(truth))])
    np.testing.assert_allclose(ours, theirs, atol=2e-4)


def test_four_hundred_poses_take_well_under_a_second():
    truth, believed = _noisy_square(np.random.default_rng(6), per_side=99)
    last = len(truth) - 1
    edges = joined(chain(believed, _covariances(last)), _loop_edge(0, last, truth[-1]))
    begin = time.process_time()
    optimise(believed, edges)
    assert time.process_time() - begin < 1.0
    assert planar(truth[-1])[0] == pytest.approx(0.0, abs=1e-9)


def test_a_pose_of_which_the_edges_say_nothing_stays_where_it_is():
    from scipy.sparse import diags

    from rhs.estimation.filters.pose_graph import _factored

    factor = _factored(diags([4.0, 0.0, 2.0]).tocsc())  # singular to the last bit
    assert factor.solve(np.array([4.0, 0.0, 4.0])) == pytest.approx([1.0, 0.0, 2.0])
