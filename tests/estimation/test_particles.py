"""The particle filter's steps against numbers one can work out, and the likelihood field against a drawn room."""

import numpy as np
import pytest

from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan
from rhs.estimation.filters.clusters import ClusterSettings, cluster_labels, resampled_by_clusters, reweighted_by_clusters
from rhs.estimation.filters.particles import (
    ParticleSet,
    SizeLaw,
    around,
    displaced,
    effective_size,
    even,
    merged,
    needed,
    peak,
    resampled,
    reweighted,
)
from rhs.estimation.scans.likelihood_field import FieldSettings, LikelihoodField
from rhs.estimation.scans.rays import cast

RNG = np.random.default_rng


def test_motion_without_noise_moves_every_particle_in_its_own_frame():
    states = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, np.pi / 2]])
    out = displaced(states, np.array([1.0, 0.0, 0.1]), np.zeros((3, 3)), RNG(0))
    np.testing.assert_allclose(out, [[1.0, 0.0, 0.1], [1.0, 3.0, np.pi / 2 + 0.1]], atol=1e-12)


def test_noise_of_the_motion_has_the_covariance_asked_for():
    covariance = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.002], [0.0, 0.002, 0.01]])
    out = around(np.array([5.0, -1.0, 0.0]), covariance, 200_000, RNG(1))
    np.testing.assert_allclose(np.cov(out.T), covariance, atol=2e-3)
    np.testing.assert_allclose(out.mean(axis=0), [5.0, -1.0, 0.0], atol=5e-3)


def test_weights_follow_bayes_and_never_vanish():
    cloud = even(np.zeros((3, 3)))
    out, evidence = reweighted(cloud, np.log([1.0, 2.0, 5.0]))
    np.testing.assert_allclose(out.weights, [1 / 8, 2 / 8, 5 / 8])
    assert evidence == pytest.approx(np.log(8 / 3))
    far, _ = reweighted(cloud, np.array([-5000.0, -5001.0, -6000.0]))
    np.testing.assert_allclose(far.weights, [1 / (1 + np.exp(-1)), np.exp(-1) / (1 + np.exp(-1)), 0.0], atol=1e-12)
    for useless in (np.full(3, -np.inf), np.full(3, np.nan)):
        np.testing.assert_allclose(reweighted(out, useless)[0].weights, 1 / 3)


def test_effective_size_counts_equal_particles():
    assert effective_size(even(np.zeros((50, 3)))) == pytest.approx(50.0)
    with np.errstate(divide="ignore"):
        assert effective_size(ParticleSet(np.zeros((2, 3)), np.log([1.0, 0.0]))) == pytest.approx(1.0)


def test_low_variance_resampling_copies_in_proportion_to_the_weight():
    states = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    law = SizeLaw(least=1000, most=1000)
    out = resampled(ParticleSet(states, np.log([0.2, 0.5, 0.3])), law, RNG(2))
    counts = [(out.states[:, 0] == x).sum() for x in (0.0, 10.0, 20.0)]
    np.testing.assert_allclose(counts, [200, 500, 300], atol=1)  # a comb errs by one tooth, a lottery by sqrt(n)


def test_resampling_keeps_equal_clusters_equal_for_ever():
    states = np.concatenate([around(np.array([x, 0.0, 0.0]), 1e-4 * np.eye(3), 500, RNG(3)) for x in (0.0, 30.0)])
    cloud, rng = even(states), RNG(4)
    for _ in range(200):
        cloud = resampled(cloud, SizeLaw(300, 5000), rng)
    assert abs((cloud.states[:, 0] > 15).mean() - 0.5) < 0.02


def test_fewer_particles_are_needed_for_a_sharp_belief():
    law = SizeLaw(least=100, most=50_000)
    sharp = around(np.zeros(3), 1e-6 * np.eye(3), 5000, RNG(5))
    vague = np.column_stack([RNG(6).uniform(0, 20, (5000, 2)), RNG(7).uniform(-np.pi, np.pi, 5000)])
    assert needed(sharp, law) <= 300  # spread over the 8 bins that meet in the origin
    assert needed(vague, law) > 20_000


def test_the_size_law_is_foxs():
    # Two bins, epsilon 0.05, quantile 2.33: (1 / 0.1) (1 - 2/9 + sqrt(2/9) 2.33)^3 = 66.04
    states = np.array([[0.1, 0.1, 0.05], [0.4, 0.1, 0.05]])
    assert needed(states, SizeLaw(least=1, most=1000)) == 67


def test_the_peak_is_the_heavier_cluster_with_its_spread_and_mass():
    a = around(np.array([3.0, 1.0, 3.1]), np.diag([0.01, 0.0025, 0.0004]), 3000, RNG(8))
    b = around(np.array([9.0, 5.0, 0.0]), 1e-3 * np.eye(3), 1000, RNG(9))
    found = peak(even(np.concatenate([a, b])), near_m=0.25, near_rad=np.radians(5.0))
    assert found.mass == pytest.approx(0.75, abs=0.01)
    np.testing.assert_allclose(found.mean[:2], [3.0, 1.0], atol=0.02)
    np.testing.assert_allclose(np.diag(found.covariance), [0.01, 0.0025, 0.0004], rtol=0.15)
    assert 0.6 < found.near < 0.75


def test_a_cluster_across_the_half_turn_is_one_heap():
    found = peak(even(around(np.array([0.0, 0.0, np.pi]), 0.01 * np.eye(3), 2000, RNG(10))), near_m=1.0, near_rad=1.0)
    assert found.mass > 0.95
    assert abs(abs(found.mean[2]) - np.pi) < 0.02


def test_clusters_are_told_apart_also_across_the_half_turn():
    places = [(0.0, 0.0, np.pi), (5.0, 0.0, 0.0), (0.0, 0.0, 0.5)]
    states = np.concatenate([around(np.array(p), 0.005 * np.eye(3), 300, RNG(13)) for p in places])
    labels = cluster_labels(states)
    assert len(np.unique(labels)) == 3
    for k in range(3):
        assert len(np.unique(labels[300 * k : 300 * (k + 1)])) == 1


def test_between_clusters_a_small_advantage_is_no_evidence_and_a_large_one_is():
    states = np.concatenate([np.zeros((2, 3)), np.full((2, 3), 5.0)])
    labels = np.array([0, 0, 1, 1])
    small, _ = reweighted_by_clusters(even(states), np.array([-1.0, -1.0, -1.9, -1.9]), labels, ClusterSettings(1.0, 0.3))
    np.testing.assert_allclose(small.weights, 0.25)
    large, _ = reweighted_by_clusters(even(states), np.array([0.0, 0.0, -11.0, -11.0]), labels, ClusterSettings(1.0, 0.3))
    assert large.weights[:2].sum() == pytest.approx(1 / (1 + np.exp(-3.0)))
    known = np.array([0.0, -np.log(3), 0.0, 0.0])
    within, _ = reweighted_by_clusters(even(states), known, labels, ClusterSettings(1.0, 0.3))
    assert within.weights[0] / within.weights[1] == pytest.approx(3.0)


def test_resampling_by_clusters_keeps_their_weights_and_the_light_ones_alive():
    states = np.concatenate([around(np.array([x, 0.0, 0.0]), 1e-4 * np.eye(3), 500, RNG(3)) for x in (0.0, 30.0)])
    cloud, rng = merged(even(states[:500]), 0.999, even(states[500:]), 0.001), RNG(4)
    for _ in range(100):
        cloud = resampled_by_clusters(cloud, SizeLaw(300, 5000), rng)
    far = cloud.states[:, 0] > 15
    assert cloud.weights[far].sum() == pytest.approx(0.001, rel=1e-6) and far.sum() >= 60


def test_merging_keeps_the_shares():
    both = merged(even(np.zeros((10, 3))), 3.0, even(np.ones((5, 3))), 1.0)
    assert both.weights[:10].sum() == pytest.approx(0.75) and len(both) == 15


def _room() -> OccupancyGrid:
    """6 x 4 m with a box in one corner, so that no two corners look alike."""
    probability = np.full((40, 60), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    probability[1:12, 1:20] = 0.98
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


def scan_in(grid: OccupancyGrid, state: np.ndarray, fov_rad: float = 4.0) -> Scan:
    bearings = np.linspace(-fov_rad / 2, fov_rad / 2, 181)
    return Scan(bearings, cast(grid.occupied(), grid, state[:2], bearings + state[2], 10.0) + 0.05, 10.0)


def test_a_scan_fits_best_where_it_was_taken():
    grid = _room()
    field = LikelihoodField(grid, FieldSettings())
    truth = np.array([4.0, 2.0, 0.7])
    scan = scan_in(grid, truth)
    rivals = np.vstack([truth, field.anywhere(3000, RNG(11))])
    likely = field.log_likelihood(rivals, scan)
    assert likely.argmax() == 0 or np.linalg.norm((rivals[likely.argmax()] - truth)[:2]) < 0.15
    shifted = field.log_likelihood(truth + [[0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.2]], scan)
    assert (likely[0] > shifted).all()


def test_poses_in_walls_and_outside_are_unlikely_and_blind_scans_say_nothing():
    grid = _room()
    field = LikelihoodField(grid, FieldSettings())
    scan = scan_in(grid, np.array([4.0, 2.0, 0.7]))
    good, inside, outside = field.log_likelihood(np.array([[4.0, 2.0, 0.7], [1.0, 0.5, 0.7], [-9.0, 2.0, 0.7]]), scan)
    assert good > inside + 5 and good > outside + 5
    blind = Scan(scan.bearings_rad, np.full(181, np.nan), 10.0)
    assert (field.log_likelihood(np.zeros((4, 3)), blind) == 0).all()


def test_anywhere_is_free_room_only():
    grid = _room()
    states = LikelihoodField(grid, FieldSettings()).anywhere(2000, RNG(12))
    cells = grid.cells(states[:, :2])
    assert grid.free()[cells[:, 0], cells[:, 1]].all()
