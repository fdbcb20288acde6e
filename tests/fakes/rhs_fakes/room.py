"""The parts themselves: an empty room of 6 m by 4 m."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import Any

import numpy as np

from rhs.api.belief import moved
from rhs.api.contracts import WorldFacts
from rhs.api.geometry import camera_from_fov, planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Capture, Closure, Motion, Observation, Path, PlanReason, Scan, Tracking, Twist

BEARINGS = np.linspace(-np.pi, np.pi, 60, endpoint=False)


class Room:
    def __init__(self, settings: Any, context: Any) -> None:
        self.settings, self.context, self.closed = settings, context, False
        self.camera = camera_from_fov(settings.image_width, 24, 57.0, height_m=1.0)
        places = (("window", 3.0, 1.0), ("door", 2.0, 2.0))
        self.facts = WorldFacts("room", (1.0, 1.0, 0.0), places, (0.0, 0.0, 6.0, 4.0), 0.2)
        self.views_expected, self.index, self.stamp_s = settings.views, 0, 0.0
        self.pose = se2(1.0, 1.0, 0.0)
        if getattr(settings, "ahead", False):
            self.leads_ahead = True

    def lead(self) -> Capture | None:
        if self.index == self.settings.views:
            return None
        return self._move(0.2 if self.index else 0.0, 0.0, 0.4)

    def begin_patrol(self) -> None:
        pass

    def drive(self, command: Twist) -> Capture:
        return self._move(command.forward_mps * command.duration_s, command.turn_radps * command.duration_s,
                          command.duration_s)

    def _move(self, forward_m: float, turn_rad: float, duration_s: float) -> Capture:
        time.sleep(self.settings.delay_s)
        self.pose = self.pose @ se2(forward_m, 0.0, turn_rad)
        self.index += 1
        self.stamp_s += duration_s
        return Capture(self.index, self.stamp_s, travel=np.array([forward_m, 0.0, turn_rad]))

    def truth(self) -> np.ndarray:
        return self.pose.copy()

    def clearance_m(self) -> tuple[float, bool]:
        x, y, _ = planar(self.pose)
        return min(x, y, 6.0 - x, 4.0 - y) - 0.2, False

    def close(self) -> None:
        self.closed = True


class ImuRoom(Room):
    """The room with an IMU: (5, 7) rows of time, angular velocity and acceleration."""

    def _move(self, forward_m: float, turn_rad: float, duration_s: float) -> Capture:
        capture = super()._move(forward_m, turn_rad, duration_s)
        imu = np.zeros((5, 7))
        imu[:, 0] = self.stamp_s - duration_s * np.linspace(0.8, 0.0, 5)
        imu[:, 3] = turn_rad / duration_s
        return replace(capture, extras={"imu": imu})


class Wheel:
    senses_ahead = True

    def __init__(self, context: Any) -> None:
        self.camera, self.rng = context.camera, context.rng

    def sense(self, capture: Capture) -> Observation:
        wheel = capture.travel + 1e-3 * self.rng.standard_normal(3)
        wheel.flags.writeable = False
        scan = Scan(BEARINGS, np.full(len(BEARINGS), np.inf), 5.0)  # an empty room, larger than it sees
        return Observation(capture.index, capture.stamp_s, self.camera, scan=scan, wheel=wheel)


class Counter:
    def update(self, observation: Observation) -> Motion:
        first = observation.index == 1
        step = np.eye(4) if first or observation.wheel is None else se2(*observation.wheel)
        return Motion(step, 1e-6 * np.eye(6), Tracking.OK)

    def revise(self) -> None:
        return None


class Inertial(Counter):
    """Distance by the wheel, heading by the gyroscope."""

    def update(self, observation: Observation) -> Motion:
        motion = super().update(observation)
        if "imu" not in observation.extras or observation.index == 1:
            return motion
        seconds = 5 * float(np.diff(observation.extras["imu"][:2, 0])[0])
        turn_rad = float(observation.extras["imu"][:, 3].mean()) * seconds
        return replace(motion, previous_from_body=se2(motion.previous_from_body[0, 3], 0.0, turn_rad))


class Closer:
    def close(self, views: Any) -> Closure:
        return Closure(np.stack([view.map_from_body for view in views]))


class Empty:
    def update(self, map_from_body: np.ndarray, scan: Scan) -> None:
        pass

    def grid(self) -> OccupancyGrid:
        return OccupancyGrid(np.full((40, 60), 0.05, np.float32), 0.1, (0.0, 0.0))

    def reset(self) -> None:
        pass


class Straight:
    def __init__(self, settings: Any, context: Any) -> None:
        self.settings, self.context = settings, context

    def plan(self, problem: Any) -> Path:
        points = np.stack([problem.start_m, problem.goal_m])
        along = np.linspace(*points, 200)
        column, row = np.floor((along - problem.origin_m) / problem.resolution_m + 1e-9).astype(int).T
        rows, columns = problem.blocked.shape
        inside = (row >= 0) & (column >= 0) & (row < rows) & (column < columns)
        if problem.blocked[row[inside], column[inside]].any():
            return Path(PlanReason.DISCONNECTED, np.empty((0, 2)), np.empty((0, 2)))
        return Path(PlanReason.OK, points, points)


class Believer:
    def learn(self, views: Any, grid: OccupancyGrid) -> None:
        pass

    def start(self, belief: Any) -> None:
        self.belief = belief

    def update(self, observation: Observation, motion: Motion) -> Any:
        self.belief = moved(self.belief, motion)
        return self.belief


class Quitter(Believer):
    """Ends the process at its third view, without a word."""

    views = 0

    def update(self, observation: Observation, motion: Motion) -> Any:
        self.views += 1
        if self.views == 3:
            os._exit(3)
        return super().update(observation, motion)


class Scribbler(Believer):
    """Changes the map, the views and the observations it is shown, as far as it is allowed to."""

    def learn(self, views: Any, grid: OccupancyGrid) -> None:
        self._scribble(grid.probability, *(view.map_from_body for view in views))

    def update(self, observation: Observation, motion: Motion) -> Any:
        self._scribble(observation.wheel, observation.scan.ranges_m if observation.scan else None)
        return super().update(observation, motion)

    @staticmethod
    def _scribble(*arrays: np.ndarray | None) -> None:
        for array in arrays:
            if array is not None and array.flags.writeable:
                array[:] = 0.7
