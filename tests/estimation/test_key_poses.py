"""A long way solved by a few of its poses, against the graph of all of them."""

import numpy as np

from rhs.api.geometry import exp_se3, inverse, se2
from rhs.estimation.filters.key_poses import KeyPoses, key_rows
from rhs.estimation.filters.pose_graph import CommonScale, Edges, chain, joined, optimise


def _drifted(rng, count=400):
    """Two laps of a circle as believed, the covariances of the motions, and the true pose of the last."""
    step, truth, believed = se2(0.1, 0.0, 4.0 * np.pi / (count - 1)), [np.eye(4)], [np.eye(4)]
    sigma = np.array([0.005, 0.002, 0.001, 0.0003, 0.0003, 0.003]) * rng.uniform(0.5, 2.0, (count - 1, 1))
    for noise in sigma * rng.normal(size=(count - 1, 6)):
        truth.append(truth[-1] @ step)
        believed.append(believed[-1] @ step @ exp_se3(noise))
    return np.stack(truth), np.stack(believed), sigma[:, :, None] ** 2 * np.eye(6)


def _loops(truth, pairs):
    begin, end = np.array(pairs).T
    return Edges(begin, end, inverse(truth[begin]) @ truth[end], np.tile(1e-6 * np.eye(6), (len(pairs), 1, 1)),
                 np.ones(len(pairs), bool))


def test_a_few_poses_of_a_long_way_are_put_where_all_of_them_would_be():
    """Three loops move the way by decimetres; key poses move every pose as the graph of all does to 0.2 % of that."""
    truth, believed, covariances = _drifted(np.random.default_rng(5))
    loops = _loops(truth, [(3, 203), (110, 309), (60, 398)])
    every = optimise(believed, joined(chain(believed, covariances), loops)).poses
    keys = KeyPoses(believed, covariances, key_rows(len(believed), 20, loops.from_at, loops.to_at))
    assert len(keys.rows) == 26
    graph = joined(keys.chain(), Edges(*(np.searchsorted(keys.rows, at) for at in (loops.from_at, loops.to_at)),
                                       loops.from_from_to, loops.covariances, loops.robust))
    few = keys.filled(optimise(believed[keys.rows], graph).poses)
    moved = np.linalg.norm((every - believed)[:, :3, 3], axis=1)
    assert moved.max() > 0.1
    assert np.linalg.norm((few - every)[:, :3, 3], axis=1).max() < 0.002 * moved.max()
    turns = few[:, :3, :3]
    np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.tile(np.eye(3), (400, 1, 1)), atol=1e-9)


def test_metres_that_are_all_too_short_grow_between_the_key_poses_too():
    """A straight way of 40 steps of 0.1 m that the loop says is 4.2 m long."""
    believed = np.stack([se2(0.1 * k, 0.0, 0.0) for k in range(41)])
    keys = KeyPoses(believed, np.tile(1e-8 * np.eye(6), (40, 1, 1)), key_rows(41, 4))
    odometry, loop = keys.chain(), _loops(np.stack([np.eye(4), se2(4.2, 0.0, 0.0)]), [(0, 1)])
    loop = Edges(loop.from_at, np.array([len(odometry)]), loop.from_from_to, loop.covariances, loop.robust)
    graph = joined(odometry, loop)
    found = optimise(believed[keys.rows], graph, scale=CommonScale(np.arange(len(graph)) < len(odometry), 1.0))
    np.testing.assert_allclose(keys.filled(found.poses, found.share)[:, 0, 3], 0.105 * np.arange(41), atol=2e-4)


def test_a_short_way_keeps_all_its_poses_to_the_bit():
    _, believed, covariances = _drifted(np.random.default_rng(6), count=30)
    keys = KeyPoses(believed, covariances, key_rows(30, 30))
    np.testing.assert_array_equal(keys.chain().from_from_to, chain(believed, covariances).from_from_to)
    np.testing.assert_array_equal(keys.chain().covariances, covariances)
    assert keys.filled(believed) is believed
