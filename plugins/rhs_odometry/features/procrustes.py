"""Frame-to-frame RGB-D odometry (thesis section 3.1): SIFT, ratio test, RANSAC, weighted Procrustes, refinement.

Past the thesis: pairs are weighted by the inverse variance of their depth (eqs 3.1-3.7 with weights that are not 1),
the result can be refined on reprojection errors, pixels and depths weighed by the noise they show, carries a
covariance, and says when it is degenerate or lost.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.geometry import adjoint, compose_covariance, inverse, log_se3
from rhs.api.records import Features, Motion, Observation, Tracking
from rhs.estimation.filters.kalman import gate
from rhs.estimation.views import features as vision
from rhs.estimation.views.rigid import PointNoise, Rigid, ransac_rigid, refine_measured
from rhs.estimation.views.settings import RansacSettings

from ..fused.fallback import guess_motion
from .config import Procrustes
from .floor import Floor


@dataclass(frozen=True, eq=False)
class Reference:
    """The view that the next one is matched with: the previous one, or after lost views the last that showed enough.

    reference_from_previous: 4x4 guessed motion over the lost views with its 6x6 covariance; age: how many they were."""

    features: Features
    reference_from_previous: np.ndarray = field(default_factory=lambda: np.eye(4))
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    age: int = 0


class ProcrustesOdometry(Odometry):
    """See the module; one instance follows one camera."""

    def __init__(self, settings: Procrustes, context: Context) -> None:
        camera = context.camera
        self._settings = settings
        self._feature_settings = context.features
        self._rng = context.rng
        self._body_from_camera = camera.body_from_camera
        on_floor = settings.planar and camera.height_m > 0.0  # a hand-held camera stands on nothing
        self._floor = Floor(settings.advanced.sway) if on_floor else None
        self._noise = PointNoise(
            np.sqrt(camera.fx * camera.fy),
            settings.pixel_sigma_px,
            settings.depth_constant_m,
            settings.depth_quadratic_per_m,
        )
        self._ransac = RansacSettings(settings.hypotheses, settings.gate_sigma)
        self._reference: Reference | None = None
        self._last = np.eye(4)
        self._disagrees = gate(6, settings.advanced.wheels_probability)

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation: match, find the rigid motion, refine, judge."""
        current = self._features(observation)
        if self._reference is None:
            self._reference = Reference(current)
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, reason="first view")
        expected = self._expected(observation)
        found, details = self._estimate(self._reference.features, current, expected)
        motion = self._judge(observation, found, details)
        self._reference = self._next_reference(current, motion)
        self._last = motion.previous_from_body
        return motion

    def _next_reference(self, current: Features, motion: Motion) -> Reference:
        """The current view; or the old one still, when the current view is lost and shows too little to go on from."""
        old = self._reference
        seen = np.isfinite(current.points[:, 2]).sum() >= 2 * self._settings.min_inliers
        if old is None or motion.status is not Tracking.LOST or seen or old.age >= self._settings.advanced.reference_age:
            return Reference(current)
        covariance = compose_covariance(old.covariance, motion.previous_from_body, motion.covariance)
        return Reference(old.features, old.reference_from_previous @ motion.previous_from_body, covariance, old.age + 1)

    def _features(self, observation: Observation) -> Features:
        return vision.features(observation, self._feature_settings)

    @property
    def _ratio(self) -> float:
        return self._feature_settings.ratio

    def _expected(self, observation: Observation) -> tuple[np.ndarray, np.ndarray] | None:
        """Camera motion (4x4) since the last view and its information (6x6) by the wheels; None without them."""
        if observation.wheel is None or self._reference is None or self._reference.age:
            return None
        name, pose, covariance = guess_motion(observation, self._last, self._settings.advanced.guess)
        if name != "wheel":
            return None
        camera_from_body = inverse(self._body_from_camera)
        move = adjoint(camera_from_body)
        return camera_from_body @ pose @ self._body_from_camera, np.linalg.inv(move @ covariance @ move.T)

    def _estimate(self, previous: Features, current: Features, expected: tuple[np.ndarray, np.ndarray] | None
                  ) -> tuple[Rigid | None, dict[str, float]]:
        """The motion between two views, and how many matches, pairs with depth it is from. expected: see _expected."""
        rows = vision.match(current, previous, self._ratio)
        matches = len(rows)
        rows = rows[np.isfinite(current.points[rows[:, 0], 2]) & np.isfinite(previous.points[rows[:, 1], 2])]
        p, q = current.points[rows[:, 0]].astype(float), previous.points[rows[:, 1]].astype(float)
        found = ransac_rigid(p, q, noise=self._noise, rng=self._rng, settings=self._ransac)
        if found is not None and expected is not None:
            found = self._of_the_robot(found, p, q, expected)
        if found is not None:
            found = self._refined(found, p, q, (previous, current, rows))
        return found, {"matches": float(matches), "pairs": float(len(p))}

    def _of_the_robot(self, found: Rigid, p: np.ndarray, q: np.ndarray, expected: tuple[np.ndarray, np.ndarray]) -> Rigid:
        """The motion found, or where the wheels say another, the next one that enough of the other pairs agree on and the
        wheels too: somebody who walks by close to the camera has more of the picture than what stands still."""
        tried, others = found, np.ones(len(p), bool)
        for _ in range(self._settings.advanced.movers + 1):
            off = log_se3(inverse(expected[0]) @ tried.a_from_b)
            if off @ expected[1] @ off < self._disagrees:
                return tried
            others &= ~tried.inliers
            rows = np.flatnonzero(others)
            next_best = ransac_rigid(p[rows], q[rows], noise=self._noise, rng=self._rng, settings=self._ransac)
            if next_best is None or next_best.count < self._settings.min_inliers:
                break
            inliers = np.zeros(len(p), bool)
            inliers[rows[next_best.inliers]] = True
            tried = replace(next_best, inliers=inliers)
        return found

    def _refined(self, found: Rigid, p: np.ndarray, q: np.ndarray, seen: tuple[Features, Features, np.ndarray]) -> Rigid:
        """A better motion from the one the pairs agree on. seen: the previous and the current view, and the rows (M, 2)
        of the current and of the previous one that the pairs are from."""
        if self._settings.refine == "none":
            return found
        return refine_measured(found, p, q, noise=self._noise, gate_sigma=self._settings.gate_sigma)

    def _judge(self, observation: Observation, found: Rigid | None, details: dict[str, float]) -> Motion:
        inliers = 0 if found is None else found.count
        details["inliers"] = float(inliers)
        if found is None or inliers < self._settings.min_inliers:
            name, guess, covariance = guess_motion(observation, self._last, self._settings.advanced.guess)
            least = self._settings.min_inliers
            reason = f"{inliers} of {details['pairs']:.0f} pairs agree, {least} needed; took {name}"
            return Motion(guess, covariance, Tracking.LOST, reason, details=details)
        pose, covariance = self._since_previous(*body_motion(found, self._body_from_camera))
        information = np.linalg.inv(covariance)
        if self._floor is not None:
            pose, covariance = self._floor.hold(pose, information)
        observability = np.sqrt(np.diag(information))
        weak = weakness(covariance, self._settings)
        status = Tracking.DEGENERATE if weak else Tracking.OK
        return Motion(pose, covariance, status, weak, observability, details=details)

    def _since_previous(self, pose: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motion since the previous view from that since the reference; they differ only after lost views."""
        reference = self._reference
        if reference is None or reference.age == 0:
            return pose, covariance
        pose = inverse(reference.reference_from_previous) @ pose
        move = adjoint(inverse(pose))
        return pose, covariance + move @ reference.covariance @ move.T


def weakness(covariance: np.ndarray, settings) -> str:
    """Why a motion with this covariance (6, 6) is degenerate, or nothing. settings: max_sigma_m, max_sigma_rad."""
    sigma_m, sigma_rad = (np.sqrt(np.linalg.eigvalsh(block)[-1]) for block in (covariance[:3, :3], covariance[3:, 3:]))
    if sigma_m > settings.max_sigma_m:
        return f"translation known to {sigma_m:.3f} m only, {settings.max_sigma_m} m allowed"
    if sigma_rad > settings.max_sigma_rad:
        return f"rotation known to {sigma_rad:.3f} rad only, {settings.max_sigma_rad} rad allowed"
    return ""


def body_motion(camera_motion: Rigid, body_from_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pose (4x4) and covariance (6x6) of the body's motion from those of its camera."""
    pose = body_from_camera @ camera_motion.a_from_b @ inverse(body_from_camera)
    move = adjoint(body_from_camera)
    covariance = move @ camera_motion.covariance @ move.T
    return pose, 0.5 * (covariance + covariance.T)
