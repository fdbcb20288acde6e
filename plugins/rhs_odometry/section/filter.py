"""The thesis's monocular filter, literally: a constant-velocity camera inside one straight section.

State (thesis eqs 4.1-4.3): position, orientation, linear and angular velocity of the camera; centre, orientation and log
size of the section. Orientations are rotation matrices with a rotation vector as error, so the 13 + 7 numbers have 12 + 7
error states. Measurement (eqs 4.6, 4.7): the points of view k are followed along their rays to the wall and projected
into view k + 1, so the size of the state does not depend on the number of points.

Order: view k + 1 corrects the state at k, velocities included, and only then is the state moved to k + 1. Deviation: the
gate is a chi-square test per point; the thesis relies on RANSAC in the matching. Jacobians by central differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from rhs.api.geometry import Camera, exp_so3
from rhs.estimation.filters.kalman import correct, gate, numeric_jacobian, propagate

from .config import SectionEkf

POSITION, TURN, SPEED, SPIN, CENTRE, AXIS = (slice(3 * i, 3 * i + 3) for i in range(6))
SIZE = 18
ERROR_STATES = 19


class SectionShape(Protocol):
    """Where rays inside a section meet its wall, in the frame of the section: x along it, y left, z up."""

    def meet(self, origin: np.ndarray, directions: np.ndarray, size_m: float) -> np.ndarray:
        """(M,) multiples of the (M, 3) directions from the (3,) origin; NaN where the wall is not met."""
        ...


class Round:
    """A tube of radius `size_m` (thesis section 4.2)."""

    def meet(self, origin: np.ndarray, directions: np.ndarray, size_m: float) -> np.ndarray:
        o, d = origin[1:], directions[:, 1:]
        a, b, c = (d**2).sum(1), d @ o, o @ o - size_m**2
        with np.errstate(divide="ignore", invalid="ignore"):
            return (-b + np.sqrt(b**2 - a * c)) / a


class Rectangular:
    """A corridor of half width `size_m` and a fixed ratio of height to width (thesis section 4.4)."""

    def __init__(self, aspect: float) -> None:
        self._shape = np.array([1.0, aspect])

    def meet(self, origin: np.ndarray, directions: np.ndarray, size_m: float) -> np.ndarray:
        d = directions[:, 1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (np.sign(d) * size_m * self._shape - origin[1:]) / d
        t = np.where(np.isfinite(t), t, np.inf).min(axis=1)
        return np.where(np.isfinite(t) & (t > 0), t, np.nan)


@dataclass(frozen=True, eq=False)
class SectionState:
    """position (3,) and rotation (3, 3) of the camera in the map, speed (3,) m/s in the map, spin (3,) rad/s in the
    camera; centre (3,), axes (3, 3) (columns: along, left, up) and log_size of the section."""

    position: np.ndarray
    rotation: np.ndarray
    speed: np.ndarray
    spin: np.ndarray
    centre: np.ndarray
    axes: np.ndarray
    log_size: float

    def plus(self, delta: np.ndarray) -> SectionState:
        """The state moved by an error (19,)."""
        return SectionState(
            self.position + delta[POSITION],
            self.rotation @ exp_so3(delta[TURN]),
            self.speed + delta[SPEED],
            self.spin + delta[SPIN],
            self.centre + delta[CENTRE],
            self.axes @ exp_so3(delta[AXIS]),
            self.log_size + float(delta[SIZE]),
        )


class SectionFilter:
    """The filter over pairs of views. state and covariance (19, 19) belong to the last view. With more than one iteration
    the same view is linearised again (Bell and Cathey 1993)."""

    def __init__(self, camera: Camera, section: SectionShape, state: SectionState, covariance: np.ndarray,
                 settings: SectionEkf) -> None:
        self.state, self.covariance, self.accepted = state, covariance, float("nan")
        self.section = section
        self._camera, self._settings, self._advanced = camera, settings, settings.advanced

    def step(self, before: np.ndarray, after: np.ndarray, seconds: float) -> None:
        """Take in a view: (M, 2) pixels of the same points in the last view and in this one."""
        self._correct(before, after, seconds)
        self._predict(seconds)

    def predicted(self, state: SectionState, rays: np.ndarray, seconds: float) -> np.ndarray:
        """(M, 2) pixels in view k + 1 of points seen along (M, 3) camera rays in view k (eq. 4.6)."""
        points = self.back_project(state, rays)
        rotation = state.rotation @ exp_so3(state.spin * seconds)
        return self._camera.project((points - state.position - state.speed * seconds) @ rotation)

    def back_project(self, state: SectionState, rays: np.ndarray) -> np.ndarray:
        """(M, 3) points of the map where the rays of the camera pierce the section (eq. 4.7); NaN where they do not."""
        directions = rays @ state.rotation.T
        local = state.axes.T @ (state.position - state.centre)
        reach = self.section.meet(local, directions @ state.axes, float(np.exp(state.log_size)))
        return state.position + directions * reach[:, None]

    def _correct(self, before: np.ndarray, after: np.ndarray, seconds: float) -> None:
        rays = self._camera.rays(before)
        distance = np.linalg.norm(self.back_project(self.state, rays) - self.state.position, axis=1)
        usable = (distance < self._advanced.farthest_m) & np.isfinite(self.predicted(self.state, rays, seconds)).all(1)
        self.accepted = float("nan")
        if usable.sum() < 4:
            return
        rays, after = rays[usable], after[usable]
        delta, start = np.zeros(ERROR_STATES), self.state
        for _ in range(self._settings.iterations):
            jacobian, residual = self._linearise(start, delta, (rays, after, seconds))
            good = self._gated(jacobian, residual + jacobian @ delta)
            rows, noise = jacobian[good].reshape(-1, ERROR_STATES), self._settings.pixel_sigma_px**2
            innovation = (residual[good] + jacobian[good] @ delta).ravel()
            change = correct(self.covariance, rows, innovation, noise * np.eye(len(rows)))
            delta = change.delta
        self.accepted = float(good.mean())
        self.state, self.covariance = start.plus(delta), change.covariance

    def _linearise(self, start: SectionState, delta: np.ndarray, view) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian (M, 2, 19) and residual (M, 2) at start + delta; points that leave the picture there count nothing."""
        rays, after, seconds = view
        jacobian = numeric_jacobian(lambda d: self.predicted(start.plus(delta + d), rays, seconds).ravel(),
                                    np.zeros(ERROR_STATES)).reshape(len(rays), 2, ERROR_STATES)
        residual = after - self.predicted(start.plus(delta), rays, seconds)
        whole = np.isfinite(jacobian).all((1, 2)) & np.isfinite(residual).all(1)
        return np.where(whole[:, None, None], jacobian, 0.0), np.where(whole[:, None], residual, 0.0)

    def _gated(self, jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
        """(M,) bool: each point on its own agrees with the state."""
        spread = jacobian @ self.covariance @ np.swapaxes(jacobian, 1, 2) + self._settings.pixel_sigma_px**2 * np.eye(2)
        normalised = (residual * np.linalg.solve(spread, residual[..., None])[..., 0]).sum(1)
        return normalised < gate(2, self._advanced.gate_probability)

    def _predict(self, seconds: float) -> None:
        """Constant velocity (eq. 4.5); the section stays, but for a little noise that keeps it adjustable."""
        s, turn = self.state, exp_so3(self.state.spin * seconds)
        transition = np.eye(ERROR_STATES)
        transition[POSITION, SPEED] = seconds * np.eye(3)
        transition[TURN, TURN] = turn.T
        transition[TURN, SPIN] = seconds * np.eye(3)
        sigma = np.zeros(ERROR_STATES)
        sigma[SPEED], sigma[SPIN] = self._settings.speed_walk_mps, self._settings.turn_walk_radps
        sigma[CENTRE], sigma[AXIS] = self._advanced.centre_walk_m, self._advanced.axis_walk_rad
        self.covariance = propagate(self.covariance, transition, np.diag(sigma**2))
        self.state = replace(s, position=s.position + s.speed * seconds, rotation=s.rotation @ turn)
