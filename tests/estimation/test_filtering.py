"""The Kalman filters against cases that can be worked out by hand, and against statistics."""

import numpy as np
import pytest

from rhs.estimation.filters import kalman as filtering


def test_two_equal_measurements_average_and_halve_the_variance():
    kf = filtering.KalmanFilter(np.eye(1), np.zeros((1, 1)), np.eye(1), np.array([[4.0]]))
    state, change = kf.update(filtering.Gaussian(np.array([0.0]), np.array([[4.0]])), np.array([3.0]))
    assert state.mean[0] == pytest.approx(1.5)
    assert state.covariance[0, 0] == pytest.approx(2.0)
    assert change.nis == pytest.approx(9.0 / 8.0)


def test_random_walk_variance_settles_at_the_golden_ratio():
    """With A = H = Q = R = 1 the Riccati equation P^2 - P - 1 = 0 gives the golden ratio as predicted variance."""
    one = np.eye(1)
    kf = filtering.KalmanFilter(one, one, one, one)
    state = filtering.Gaussian(np.zeros(1), one)
    for _ in range(60):
        predicted = kf.predict(state)
        state, _ = kf.update(predicted, np.zeros(1))
    assert predicted.covariance[0, 0] == pytest.approx((1 + 5**0.5) / 2, abs=1e-12)


def test_control_input_moves_the_mean():
    kf = filtering.KalmanFilter(np.eye(2), np.zeros((2, 2)), np.eye(2), np.eye(2), control=np.array([[1.0], [2.0]]))
    state = kf.predict(filtering.Gaussian(np.zeros(2), np.eye(2)), np.array([3.0]))
    assert state.mean == pytest.approx([3.0, 6.0])


def _constant_velocity(rng, steps=80):
    f = np.array([[1.0, 1.0], [0.0, 1.0]])
    q = 0.01 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    kf = filtering.KalmanFilter(f, q, np.array([[1.0, 0.0]]), np.array([[0.25]]))
    p0 = np.diag([1.0, 1.0])
    truth = rng.multivariate_normal(np.zeros(2), p0)
    state, nees, nis = filtering.Gaussian(np.zeros(2), p0), [], []
    for _ in range(steps):
        truth = f @ truth + rng.multivariate_normal(np.zeros(2), q)
        state, change = kf.update(kf.predict(state), truth[:1] + 0.5 * rng.standard_normal(1))
        nees.append(filtering.nees(truth - state.mean, state.covariance))
        nis.append(change.nis)
    return nees, nis


def test_tracking_a_target_is_consistent_in_nees_and_nis():
    """Bar-Shalom's test: over 40 runs the averages lie inside their 99.9 % chi-square bounds."""
    rng = np.random.default_rng(0)
    runs = [_constant_velocity(rng) for _ in range(40)]
    last_nees = np.mean([r[0][-1] for r in runs])
    low, high = filtering.consistency_bounds(2, 40, 0.999)
    assert low < last_nees < high
    all_nis = np.concatenate([r[1] for r in runs])
    low, high = filtering.consistency_bounds(1, len(all_nis), 0.999)
    assert low < all_nis.mean() < high


def test_extended_filter_on_a_linear_system_is_the_linear_filter():
    f, h = np.array([[1.0, 0.5], [0.0, 0.9]]), np.array([[1.0, 2.0]])
    q, r = np.diag([0.2, 0.1]), np.array([[0.3]])
    kf = filtering.KalmanFilter(f, q, h, r)
    ekf = filtering.ExtendedKalmanFilter(lambda x, u, e: f @ x + e, lambda x, d: h @ x + d, q, r)
    a = b = filtering.Gaussian(np.array([1.0, -1.0]), np.eye(2))
    for z in (0.3, -0.2, 1.0):
        a, _ = kf.update(kf.predict(a), np.array([z]))
        b, _ = ekf.update(ekf.predict(b, np.zeros(0)), np.array([z]))
    assert b.mean == pytest.approx(a.mean, abs=1e-8)
    assert b.covariance == pytest.approx(a.covariance, abs=1e-8)


def test_extended_filter_uses_both_noise_jacobians():
    """x' = x + 3 e gives variance 1 + 9 q; z = x + 2 d gives innovation variance P + 4 r."""
    ekf = filtering.ExtendedKalmanFilter(
        lambda x, u, e: x + u + 3 * e, lambda x, d: x + 2 * d, np.array([[0.5]]), np.array([[0.25]])
    )
    state = ekf.predict(filtering.Gaussian(np.zeros(1), np.eye(1)), np.array([2.0]))
    assert state.mean[0] == pytest.approx(2.0)
    assert state.covariance[0, 0] == pytest.approx(5.5)
    _, change = ekf.update(state, np.array([3.0]))
    assert change.nis == pytest.approx(1.0 / 6.5)


def test_range_to_a_beacon_converges():
    """A still robot measures its distance to two beacons: a nonlinear problem with a known answer."""
    beacons = np.array([[0.0, 0.0], [4.0, 0.0]])
    ekf = filtering.ExtendedKalmanFilter(
        lambda x, u, e: x + e,
        lambda x, d: np.linalg.norm(beacons - x, axis=1) + d,
        1e-6 * np.eye(2),
        1e-4 * np.eye(2),
    )
    truth, state = np.array([1.0, 2.0]), filtering.Gaussian(np.array([1.8, 2.9]), np.eye(2))
    for _ in range(15):
        state, _ = ekf.update(ekf.predict(state, np.zeros(0)), np.linalg.norm(beacons - truth, axis=1))
    assert state.mean == pytest.approx(truth, abs=0.01)  # one standard deviation of a single range


def test_information_form_equals_joseph_form():
    rng = np.random.default_rng(1)
    a = rng.standard_normal((6, 6))
    p, h, r = a @ a.T + np.eye(6), rng.standard_normal((9, 6)), rng.standard_normal(9)
    noise = np.diag(rng.uniform(0.5, 2.0, 9))
    joseph = filtering.correct(p, h, r, noise)
    summed = filtering.correct_information(p, h.T @ np.linalg.solve(noise, h), h.T @ np.linalg.solve(noise, r))
    assert summed.delta == pytest.approx(joseph.delta, abs=1e-10)
    assert summed.covariance == pytest.approx(joseph.covariance, abs=1e-10)


def test_nearly_perfect_measurements_leave_a_symmetric_positive_covariance():
    """The plain form (I - K H) P loses this when the noise is tiny beside the prior."""
    rng = np.random.default_rng(2)
    p = np.diag([1e6, 1e6, 1e6])
    for _ in range(50):
        h = rng.standard_normal((2, 3))
        p = filtering.correct(p, h, np.zeros(2), 1e-9 * np.eye(2)).covariance
        assert np.array_equal(p, p.T)
        assert np.linalg.eigvalsh(p).min() >= -1e-18


def test_gate_is_the_chi_square_quantile():
    assert filtering.gate(2, 0.99) == pytest.approx(-2 * np.log(0.01))
    assert filtering.gate(1, 0.95) == pytest.approx(3.841458820694124)


def test_numeric_jacobian_of_a_product():
    jacobian = filtering.numeric_jacobian(lambda x: np.array([x[0] * x[1], x[0] ** 2]), np.array([2.0, 5.0]))
    assert jacobian == pytest.approx(np.array([[5.0, 2.0], [4.0, 0.0]]), abs=1e-8)
