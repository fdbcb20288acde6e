"""The odometry `fused`: depth where it shows something, structure where it does not (thesis chapter 6, future work).

Three estimates of each motion are joined by their information in SE(2), so that every direction comes from whoever knows
it: points with depth (`procrustes`), the shape of the walls (`gicp`, which knows nothing along a corridor and says so), and
the command. The heading is kept by a Kalman filter that also sees the direction of the walls, which is the same in every
view up to a quarter turn (a soft right angle).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.geometry import planar, rotation_z, se2
from rhs.api.records import Motion, Observation, Tracking
from rhs.estimation.filters.kalman import correct, propagate

from ..clouds.clouds import Cloud, CloudMaker
from ..features.procrustes import ProcrustesOdometry
from ..tracks.monocular import embed
from .config import Fused, FusedAdvanced

PLANAR = np.ix_([0, 1, 5], [0, 1, 5])
QUARTER = 0.5 * np.pi
USUAL = FusedAdvanced()


@dataclass(frozen=True, eq=False)
class Planar:
    """A motion on the floor: mean (3,) forward m, left m, turn rad, in the frame half way round the turn; covariance."""

    mean: np.ndarray
    covariance: np.ndarray


def joined(a: Planar, b: Planar) -> Planar:
    """The information-weighted mean of two independent estimates: each direction from whoever knows it better."""
    information_a, information_b = np.linalg.inv(a.covariance), np.linalg.inv(b.covariance)
    covariance = np.linalg.inv(information_a + information_b)
    return Planar(covariance @ (information_a @ a.mean + information_b @ b.mean), 0.5 * (covariance + covariance.T))


def distance(a: Planar, b: Planar) -> float:
    """Squared Mahalanobis distance between two estimates of one motion."""
    gap = a.mean - b.mean
    return float(gap @ np.linalg.solve(a.covariance + b.covariance, gap))


def planar_of(motion: Motion, widening: float) -> Planar:
    """The motion's shadow on the floor, its sigmas widened."""
    mean, covariance = planar(motion.previous_from_body), widening**2 * motion.covariance[PLANAR]
    half = rotation_z(0.5 * mean[2])
    return Planar(half.T @ [mean[0], mean[1], 0.0] + [0.0, 0.0, mean[2]], half @ covariance @ half.T)


def wall_direction(cloud: Cloud, share: float, s: FusedAdvanced = USUAL) -> float | None:
    """Direction of the walls in the body frame, radians modulo a quarter turn; None where too few surfaces agree."""
    normals = cloud.normals[np.isfinite(cloud.normals).all(axis=1)]
    upright = normals[np.abs(normals[:, 2]) < s.upright]
    if len(upright) < s.few_normals:
        return None
    angles = np.mod(np.arctan2(upright[:, 1], upright[:, 0]), QUARTER)
    counts, edges = np.histogram(angles, bins=45, range=(0.0, QUARTER))
    peak = edges[int(np.argmax(counts + np.roll(counts, 1) + np.roll(counts, -1)))] + QUARTER / 90
    for _ in range(3):
        off = folded(angles - peak)
        near = np.abs(off) < np.radians(s.near_deg)
        peak += float(off[near].mean())
    return float(np.mod(peak, QUARTER)) if near.mean() >= share else None


def folded(angle):
    """Angles brought to within an eighth of a turn: differences of directions that are the same after a quarter turn."""
    return np.mod(np.asarray(angle) + 0.5 * QUARTER, QUARTER) - 0.5 * QUARTER


class Heading:
    """Kalman filter of (yaw, direction of the walls) in the map; readings are direction minus yaw, modulo a quarter turn."""

    def __init__(self, yaw_rad: float, settings: Fused) -> None:
        self.mean = np.array([yaw_rad, 0.0])
        self.covariance = np.diag([1e-8, np.pi**2])
        self._reading = np.radians(np.hypot(settings.walls_sigma_deg, settings.right_angle_sigma_deg)) ** 2
        self._known, self._gate = False, settings.advanced.gate_sigma

    def turn(self, turn_rad: float, variance: float, reading: float | None) -> float:
        """Move by a turn, then take in a reading if there is one; returns the turn as now believed."""
        before = self.mean[0]
        self.mean = self.mean + [turn_rad, 0.0]
        self.covariance = propagate(self.covariance, np.eye(2), np.diag([variance, 0.0]))
        if reading is not None and not self._known:
            self._known = True
            self.mean[1] = self.mean[0] + reading
            self.covariance[1] = self.covariance[:, 1] = [self.covariance[0, 0], self.covariance[0, 0] + self._reading]
            self.covariance[0, 1] = self.covariance[0, 0]
        elif reading is not None:
            self._update(reading)
        return float(self.mean[0] - before)

    def _update(self, reading: float) -> None:
        row = np.array([[-1.0, 1.0]])
        residual = folded(reading - (self.mean[1] - self.mean[0]))
        spread = float((row @ self.covariance @ row.T)[0, 0]) + self._reading
        if residual**2 < self._gate**2 * spread:
            change = correct(self.covariance, row, np.array([residual]), np.array([[self._reading]]))
            self.mean, self.covariance = self.mean + change.delta, change.covariance


class FusedOdometry(Odometry):
    """See the module; one instance follows one camera."""

    def __init__(self, settings: Fused, context: Context) -> None:
        self._settings = settings
        self._pictures = ProcrustesOdometry(settings.advanced.pictures, context)
        gicp = settings.advanced.shape
        self._shape = gicp.build(context)
        self._maker = CloudMaker(context.camera, stride=gicp.stride_px, min_range_m=gicp.min_range_m,
                                 max_range_m=gicp.max_range_m)
        self._heading = Heading(float(context.world.start[2]), settings)
        self._last = np.zeros(3)
        self._begun = False

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation."""
        pictures, shape = self._pictures.update(observation), self._shape.update(observation)
        reading = self._reading(observation)
        if not self._begun:
            self._begun = True
            self._heading.turn(0.0, 0.0, reading)
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")
        both, used = self._join(observation, pictures, shape)
        turn = self._heading.turn(float(both.mean[2]), float(both.covariance[2, 2]), reading)
        self._last = np.array([both.mean[0], both.mean[1], turn])
        half = rotation_z(0.5 * turn)
        forward, left, _ = half @ [both.mean[0], both.mean[1], 0.0]
        covariance = embed(half.T @ both.covariance @ half)
        details = {"used_pictures": float("pictures" in used), "used_shape": float("shape" in used),
                   "walls_seen": float(reading is not None)}
        status, reason = self._status(used, pictures, shape)
        return Motion(se2(forward, left, turn), covariance, status, reason,
                      np.sqrt(np.diag(np.linalg.inv(covariance))), details=details)

    def _join(self, observation: Observation, pictures: Motion, shape: Motion) -> tuple[Planar, list[str]]:
        """All estimates that agree with what is believed so far, the command first."""
        belief, used = self._given(observation), []
        for name, motion, widening in (("pictures", pictures, self._settings.picture_widening),
                                       ("shape", shape, self._settings.shape_widening)):
            if motion.status is Tracking.LOST:
                continue
            estimate = planar_of(motion, widening)
            if distance(estimate, belief) < self._settings.disagreement:
                belief = joined(belief, estimate)
                used.append(name)
        return belief, used

    def _given(self, observation: Observation) -> Planar:
        """What the command, else the last motion again, says."""
        s, command = self._settings, observation.command
        if command is None:
            spread = np.array([0.1, 0.1, 0.2]) + np.abs(self._last)
            return Planar(self._last, np.diag(spread**2))
        forward, turn = command.forward_mps * command.duration_s, command.turn_radps * command.duration_s
        along = s.command_forward_share * abs(forward) + s.command_floor_m
        across = s.command_floor_m + s.advanced.sideways_share * abs(forward)
        return Planar(np.array([forward, 0.0, turn]),
                      np.diag([along, across, s.command_turn_share * abs(turn) + s.command_floor_rad]) ** 2)

    def _reading(self, observation: Observation) -> float | None:
        if observation.depth is None:
            return None
        return wall_direction(self._maker.cloud(observation.depth), self._settings.walls_share,
                              self._settings.advanced)

    def _status(self, used: list[str], pictures: Motion, shape: Motion) -> tuple[Tracking, str]:
        if "pictures" in used or ("shape" in used and shape.status is Tracking.OK):
            return Tracking.OK, ""
        if "shape" in used:
            return Tracking.DEGENERATE, f"pictures: {pictures.reason}; shape: {shape.reason}; the command fills in"
        return Tracking.LOST, f"pictures: {pictures.reason}; shape: {shape.reason}; the command alone"
