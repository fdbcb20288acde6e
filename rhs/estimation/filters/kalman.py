"""Kalman and extended Kalman filters as estimators of their own, free of any sensor, and the tests of their honesty.

The updates are written for an *error* state: `correct` returns the increment and the caller adds it, so that states
living on a manifold (poses) use the same equations as vectors. Covariances are (n, n), symmetric and positive definite.

Source: thesis section 2.2 (eqs 2.21-2.34); Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation (2001), 5.4 (NEES, NIS) and 7.2 (Joseph form). Deviation from the thesis: eqs 2.28 and 2.34 are replaced by
the Joseph form, which keeps the covariance symmetric and positive whatever the rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Gaussian:
    """mean (n,), covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Correction:
    """What a measurement changes: delta (n,) to add to the state, covariance (n, n) afterwards, and the normalised
    innovation squared `nis`, chi-square with `dof` degrees of freedom if the filter is honest."""

    delta: np.ndarray
    covariance: np.ndarray
    nis: float
    dof: int


def symmetric(matrix: np.ndarray) -> np.ndarray:
    """The symmetric part of a square matrix."""
    even: np.ndarray = 0.5 * (matrix + matrix.T)
    return even


def correct(covariance: np.ndarray, jacobian: np.ndarray, residual: np.ndarray, noise: np.ndarray) -> Correction:
    """One measurement update in Joseph form (eqs 2.31-2.33).

    jacobian (m, n) of the prediction, residual (m,) = measured - predicted, noise (m, m).
    """
    cross = covariance @ jacobian.T
    innovation = symmetric(jacobian @ cross + noise)
    gain = np.linalg.solve(innovation, cross.T).T
    keep = np.eye(len(covariance)) - gain @ jacobian
    posterior = symmetric(keep @ covariance @ keep.T + gain @ noise @ gain.T)
    return Correction(gain @ residual, posterior, nis(residual, innovation), len(residual))


def correct_information(covariance: np.ndarray, information: np.ndarray, vector: np.ndarray) -> Correction:
    """The same update when the measurements come summed up: information = sum of H' R^-1 H, vector = sum of H' R^-1 r.

    Equal to `correct` with all rows stacked, at a cost that does not depend on the number of rows. With P = L L', the
    posterior is L (I + L' A L)^-1 L': a product with its own transpose, hence positive by construction.
    nis is not known from sums alone and is NaN.
    """
    root = np.linalg.cholesky(symmetric(covariance))
    middle = np.eye(len(covariance)) + root.T @ symmetric(information) @ root
    half = np.linalg.solve(np.linalg.cholesky(symmetric(middle)), root.T)
    posterior = half.T @ half
    return Correction(posterior @ vector, symmetric(posterior), float("nan"), len(vector))


def propagate(covariance: np.ndarray, transition: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Covariance after one step of the dynamics (eqs 2.25, 2.30): F P F' + Q."""
    return symmetric(transition @ covariance @ transition.T + noise)


def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    """Normalised estimation error squared: chi-square with len(error) degrees of freedom if the filter is honest."""
    return float(error @ np.linalg.solve(covariance, error))


def nis(residual: np.ndarray, innovation: np.ndarray) -> float:
    """Normalised innovation squared of a residual (m,) whose predicted covariance is `innovation` (m, m)."""
    return float(residual @ np.linalg.solve(innovation, residual))


def gate(dof: int, probability: float = 0.99) -> float:
    """The value a chi-square variable with `dof` degrees of freedom stays below with this probability."""
    from scipy.special import chdtri

    return float(chdtri(dof, 1.0 - probability))


def consistency_bounds(dof: int, runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Between which values the mean of `runs` independent NEES (or NIS) lies with this probability, if honest."""
    from scipy.special import chdtri

    tail = 0.5 * (1.0 - probability)
    return float(chdtri(dof * runs, 1.0 - tail)) / runs, float(chdtri(dof * runs, tail)) / runs


def numeric_jacobian(function: Function, at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """(m, n) central differences of `function` at the (n,) point `at`."""
    columns = []
    for i in range(len(at)):
        nudge = np.zeros(len(at))
        nudge[i] = step
        columns.append((function(at + nudge) - function(at - nudge)) / (2.0 * step))
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class KalmanFilter:
    """The linear filter (eqs 2.21-2.28): x' = A x + B u + w, z = H x + v.

    transition A (n, n), process_noise Q (n, n), measurement H (m, n), measurement_noise R (m, m), control B (n, k).
    """

    transition: np.ndarray
    process_noise: np.ndarray
    measurement: np.ndarray
    measurement_noise: np.ndarray
    control: np.ndarray | None = None

    def predict(self, state: Gaussian, command: np.ndarray | None = None) -> Gaussian:
        mean = self.transition @ state.mean
        if self.control is not None and command is not None:
            mean = mean + self.control @ command
        return Gaussian(mean, propagate(state.covariance, self.transition, self.process_noise))

    def update(self, state: Gaussian, measured: np.ndarray) -> tuple[Gaussian, Correction]:
        residual = measured - self.measurement @ state.mean
        change = correct(state.covariance, self.measurement, residual, self.measurement_noise)
        return Gaussian(state.mean + change.delta, change.covariance), change


@dataclass(frozen=True, eq=False)
class ExtendedKalmanFilter:
    """The extended filter (eqs 2.29-2.34): x' = f(x, u, e) with e ~ N(0, Q), z = h(x, d) with d ~ N(0, R).

    dynamics f(x, u, e) -> (n,), observation h(x, d) -> (m,). Their Jacobians F, G (by x and e) and H, J (by x and d)
    are taken by central differences at zero noise: right for any f and h, and cheap at these sizes.
    process_noise Q is of e, measurement_noise R of d; neither need have the size of the state or the measurement.
    """

    dynamics: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    observation: Callable[[np.ndarray, np.ndarray], np.ndarray]
    process_noise: np.ndarray
    measurement_noise: np.ndarray

    def predict(self, state: Gaussian, command: np.ndarray) -> Gaussian:
        calm = np.zeros(len(self.process_noise))
        by_state = numeric_jacobian(lambda x: self.dynamics(x, command, calm), state.mean)
        by_noise = numeric_jacobian(lambda e: self.dynamics(state.mean, command, e), calm)
        noise = by_noise @ self.process_noise @ by_noise.T
        return Gaussian(self.dynamics(state.mean, command, calm), propagate(state.covariance, by_state, noise))

    def update(self, state: Gaussian, measured: np.ndarray) -> tuple[Gaussian, Correction]:
        exact = np.zeros(len(self.measurement_noise))
        by_state = numeric_jacobian(lambda x: self.observation(x, exact), state.mean)
        by_noise = numeric_jacobian(lambda d: self.observation(state.mean, d), exact)
        residual = measured - self.observation(state.mean, exact)
        change = correct(state.covariance, by_state, residual, by_noise @ self.measurement_noise @ by_noise.T)
        return Gaussian(state.mean + change.delta, change.covariance), change
