"""A SLAM for rhs: one part in the place of odometry, loop closer, mapper and localiser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context
from rhs.api.geometry import planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, Tracking


@dataclass
class Skeleton(Bounded):
    """The wheels are believed, and the ends of the beams are drawn: a map where `sensor.noise=false`."""

    share: float = within(0.05, 0.0, 1.0)
    """standard deviation of a step, as a share of it"""

    needs: ClassVar[frozenset[str]] = frozenset({"wheel", "scan"})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context)


class Part:
    """`poses` may be corrected at any time: trajectory, belief and grid are asked for anew."""

    def __init__(self, settings: Skeleton, context: Context) -> None:
        self.settings, self.facts = settings, context.world
        self.poses: list[np.ndarray] = []
        self.covariance = 1e-6 * np.eye(6)
        self.walls: list[np.ndarray] = []

    def update(self, observation: Observation) -> Motion:
        """The pose of this view as seen from the view before; the first has none before it."""
        step, sigma, status = np.eye(4), 1e-3, Tracking.OK
        if not self.poses:
            self.poses.append(se2(*self.facts.start))
        else:
            if observation.wheel is None:
                status, sigma = Tracking.LOST, 1.0
            else:
                step = se2(*observation.wheel)
                sigma += self.settings.share * float(np.abs(observation.wheel).sum())
            self.poses.append(self.poses[-1] @ step)
            self.covariance = self.covariance + sigma**2 * np.eye(6)
        self._draw(observation)
        return Motion(step, sigma**2 * np.eye(6), status, reason="" if status is Tracking.OK else "no wheels")

    def belief(self) -> Belief:
        """Where the robot is in the map of now."""
        return Belief(self.poses[-1], self.covariance, BeliefStatus.TRACKING)

    def trajectory(self) -> np.ndarray:
        """(N, 4, 4) of every view so far."""
        return np.stack(self.poses)

    def grid(self) -> OccupancyGrid:
        """Walls where beams ended; all else is taken for free here, which a real one must not do."""
        x0, y0, x1, y1 = self.facts.bounds_m
        chance = np.full((int(np.ceil((y1 - y0) / 0.1)), int(np.ceil((x1 - x0) / 0.1))), 0.05, np.float32)
        for ends in self.walls:
            column, row = np.floor((ends - (x0, y0)) / 0.1).astype(int).T
            inside = (row >= 0) & (row < chance.shape[0]) & (column >= 0) & (column < chance.shape[1])
            chance[row[inside], column[inside]] = 0.95
        return OccupancyGrid(chance, 0.1, (x0, y0))

    def _draw(self, observation: Observation) -> None:
        """The ends of the beams in the map."""
        scan = observation.scan
        if scan is not None:
            x, y, yaw = planar(self.poses[-1])
            hit = np.isfinite(scan.ranges_m)
            angles, reach = yaw + scan.bearings_rad[hit], scan.ranges_m[hit]
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            eye = np.array([x, y]) + turn @ np.array(scan.origin_xy_m)
            self.walls.append(eye + np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=1))
