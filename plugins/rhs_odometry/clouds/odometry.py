"""What every odometry that aligns clouds shares: the guess it starts from, its gate, and honesty about slipping.

A cloud of walls may slide along itself. The share of points that hold a direction (clouds.observability) decides: too
little and the motion is `degenerate`, its covariance wide along that direction; with slipping=guess the guess of wheels
or command replaces what the alignment says along it (solution remapping: Zhang, Kaess and Singh, ICRA 2016). And every
alignment is looked at again (second_look.py): one that lays this view beside the last one is `degenerate` too.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.geometry import log_se3
from rhs.api.records import Motion, Observation, Tracking
from rhs.estimation.filters.kalman import gate

from ..features.floor import on_floor
from ..fused.fallback import guess_motion
from .clouds import Cloud, CloudMaker, judged, observability
from .second_look import second_look


class Registration(Protocol):
    """One way of aligning clouds: knows the cloud or map of the past."""

    def align(self, cloud: Cloud, guess: np.ndarray) -> tuple[np.ndarray, str]:
        """previous_from_body of this cloud from a guess, and what was wrong with it (empty: nothing)."""

    def take_guess(self, guess: np.ndarray) -> None:
        """The cloud could not be aligned; the body is believed to have moved by the guess."""

    def correct(self, motion: np.ndarray) -> None:
        """The body is believed to have moved by this since the cloud before, whatever the last alignment said."""


class CloudOdometry(Odometry):
    """Follows a depth camera with a Registration. Settings: guess, stride_px, ranges, min_points, min_support."""

    def __init__(self, settings, context: Context, registration: Registration) -> None:
        self._settings, self._registration = settings, registration
        self._advanced = settings.advanced
        self._maker = CloudMaker(
            context.camera, stride=settings.stride_px, min_range_m=settings.min_range_m, max_range_m=settings.max_range_m
        )
        self._on_floor = settings.planar and context.camera.height_m > 0.0
        self._begun = False
        self._last = np.eye(4)
        self._cloud: Cloud | None = None  # of the last view

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation."""
        assert observation.depth is not None
        before, self._cloud = self._cloud, self._maker.cloud(observation.depth)
        cloud = self._cloud
        name, guess, wide = self._guess(observation)
        if not self._begun:
            self._begun = len(cloud) >= self._settings.min_points
            if self._begun:
                self._registration.align(cloud, np.eye(4))
            status = Tracking.OK if self._begun else Tracking.LOST
            return Motion(np.eye(4), 1e-12 * np.eye(6), status, "first view" if self._begun else _few(cloud))
        if len(cloud) < self._settings.min_points:
            self._registration.take_guess(guess)
            return self._done(Motion(guess, wide, Tracking.LOST, f"{_few(cloud)}; took {name}"))
        pose, trouble = self._registration.align(cloud, guess)
        if trouble:
            return self._done(Motion(guess, wide, Tracking.LOST, f"{trouble}; took {name}"))
        return self._done(self._turned(self._checked(self._judge(cloud, pose, guess), cloud, before)))

    def _guess(self, observation: Observation) -> tuple[str, np.ndarray, np.ndarray]:
        """The motion to start from: wheels or command where they are wanted, else the last motion again."""
        if self._settings.guess == "motion":
            return guess_motion(observation, self._last, self._advanced.guess)
        spread = np.diag([0.1**2] * 3 + [0.2**2] * 3) + np.diag([1.0] * 6) * float(np.abs(log_se3(self._last)).max()) ** 2
        return "same again", self._last, spread

    def _judge(self, cloud: Cloud, pose: np.ndarray, guess: np.ndarray) -> Motion:
        seen = observability(cloud, self._maker, on_floor=self._on_floor, settings=self._advanced)
        if self._on_floor:
            pose, _ = on_floor(pose, seen.information / self._advanced.correlated + 1e-3 * np.eye(6))
        if seen.support < self._settings.min_support and self._settings.slipping == "guess":
            pose = pose.copy()
            pose[:3, 3] += seen.weakest * float(seen.weakest @ (guess[:3, 3] - pose[:3, 3]))
            self._registration.correct(pose)
        return judged(pose, seen, self._settings, {"points": float(len(cloud))})

    def _checked(self, motion: Motion, cloud: Cloud, before: Cloud | None) -> Motion:
        """The motion, widened and called degenerate when another one lays the surface of this view on that of the last one
        clearly better."""
        if before is None or len(before) == 0:
            return motion
        a = self._advanced
        look = second_look(before, cloud, self._maker, motion.previous_from_body, a.sure_sigmas)
        off = float(look.better @ np.linalg.solve(motion.covariance, look.better))
        if np.isnan(look.cost):
            return replace(motion, status=Tracking.DEGENERATE, reason=motion.reason or "hardly anything is seen twice")
        if look.cost - look.best < a.misfit or off < gate(6, a.gate_probability):
            return motion
        covariance = motion.covariance + np.outer(look.better, look.better)
        metres, radians = (float(np.linalg.norm(part)) for part in (look.better[:3], look.better[3:]))
        reason = f"the view before fits better after {metres:.2f} m and {np.degrees(radians):.1f} degrees more"
        return replace(motion, covariance=covariance, status=Tracking.DEGENERATE, reason=motion.reason or reason,
                       observability=np.sqrt(np.diag(np.linalg.inv(covariance))))

    def _turned(self, motion: Motion) -> Motion:
        """The motion, less sure the further it turns: what comes into a narrow view has no partners yet, and pulls."""
        turn_rad = float(np.linalg.norm(log_se3(motion.previous_from_body)[3:]))
        spread = turn_rad * np.array([self._advanced.turned_m] * 3 + [self._advanced.turned_share] * 3)
        covariance = motion.covariance + np.diag(spread**2)
        return replace(motion, covariance=covariance, observability=np.sqrt(np.diag(np.linalg.inv(covariance))))

    def _done(self, motion: Motion) -> Motion:
        self._last = motion.previous_from_body
        return motion


def _few(cloud: Cloud) -> str:
    return f"only {len(cloud)} depth points"
