"""How a camera is led along a route: the poses of the views, and how a hand strays from them.

Lengths in metres, angles in radians, world frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import wrap


@dataclass(frozen=True)
class Waypoint:
    """One intended view: x, y, yaw; seconds and metres since the previous one."""

    x_m: float
    y_m: float
    yaw_rad: float
    duration_s: float
    distance_m: float


@dataclass(frozen=True)
class RoutePace:
    """step_m and turn_step_rad between views, speed_mps, turn_rate_radps on the spot, arc_radius_m (0: pivot)."""

    step_m: float
    turn_step_rad: float
    speed_mps: float
    turn_rate_radps: float
    arc_radius_m: float


def waypoints(route_m: np.ndarray, start_yaw_rad: float, pace: RoutePace) -> list[Waypoint]:
    """The intended views along a polyline (N, 2): straights in equal steps, corners by pivots or arcs."""
    legs = np.diff(route_m, axis=0)
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    turns = [float(wrap(headings[0] - start_yaw_rad))] + [float(t) for t in wrap(np.diff(headings))]
    cuts = [0.0] + [_cut(t, pace, min(a, b)) for t, a, b in zip(turns[1:], lengths[:-1], lengths[1:], strict=True)]
    views = [Waypoint(float(route_m[0, 0]), float(route_m[0, 1]), start_yaw_rad, 0.0, 0.0)]
    for leg, heading in enumerate(headings):
        if cuts[leg] > 0:
            _arc(views, turns[leg], cuts[leg], pace)
        else:
            _pivot(views, turns[leg], pace)
        end = cuts[leg + 1] if leg + 1 < len(cuts) else 0.0
        _straight(views, float(lengths[leg] - cuts[leg] - end), float(heading), pace)
    return views


def _cut(turn: float, pace: RoutePace, shorter_leg_m: float) -> float:
    """How far before and after a corner its arc begins and ends; 0 where the robot must pivot."""
    if pace.arc_radius_m <= 0 or abs(turn) < 1e-6 or abs(turn) > np.radians(150):
        return 0.0
    return min(pace.arc_radius_m * float(np.tan(abs(turn) / 2)), 0.5 * shorter_leg_m)


def _straight(views: list[Waypoint], length_m: float, heading: float, pace: RoutePace) -> None:
    if length_m < 1e-6:
        return
    steps = int(np.ceil(length_m / pace.step_m - 1e-6))
    step = length_m / steps
    for _ in range(steps):
        last = views[-1]
        views.append(Waypoint(last.x_m + step * np.cos(heading), last.y_m + step * np.sin(heading), heading,
                              step / pace.speed_mps, step))


def _pivot(views: list[Waypoint], turn: float, pace: RoutePace) -> None:
    if abs(turn) < 1e-9:
        return
    steps = int(np.ceil(abs(turn) / pace.turn_step_rad - 1e-6))
    for _ in range(steps):
        last = views[-1]
        yaw = float(wrap(last.yaw_rad + turn / steps))
        views.append(Waypoint(last.x_m, last.y_m, yaw, abs(turn) / steps / pace.turn_rate_radps, 0.0))


def _arc(views: list[Waypoint], turn: float, cut_m: float, pace: RoutePace) -> None:
    radius = cut_m / np.tan(abs(turn) / 2)
    length = radius * abs(turn)
    steps = int(np.ceil(max(length / pace.step_m, abs(turn) / pace.turn_step_rad) - 1e-6))
    step, bend = length / steps, turn / steps
    chord = 2 * radius * np.sin(abs(bend) / 2)
    for _ in range(steps):
        last = views[-1]
        middle = last.yaw_rad + bend / 2
        views.append(Waypoint(last.x_m + chord * np.cos(middle), last.y_m + chord * np.sin(middle),
                              float(wrap(last.yaw_rad + bend)), step / pace.speed_mps, step))


class Wobble:
    """A smooth random deviation as a function of the distance travelled: five sines, wavelengths 1.5 to 8 m."""

    def __init__(self, rng: np.random.Generator, rms: float) -> None:
        self.waves = 2 * np.pi / rng.uniform(1.5, 8.0, 5)
        self.phases = rng.uniform(0, 2 * np.pi, 5)
        self.amplitude = rms * np.sqrt(2 / 5)

    def __call__(self, distance_m: float) -> float:
        """Zero at the start, so that the first view stands where the world says; full after a metre."""
        return float(self.amplitude * min(1.0, distance_m) * np.sin(self.waves * distance_m + self.phases).sum())
