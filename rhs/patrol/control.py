"""From a path and a believed pose to one command: pure pursuit with bounded steps.

Coulter, R. C., "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992. Deviations: the
command is held for one step of bounded length and turn, so that consecutive views overlap; when the path lies too far
to the side the robot pivots (or, for cameras that must keep moving, turns on an arc).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import planar, wrap
from rhs.api.records import Path, Twist

MOST_TURNING_RAD = 4.0 * np.pi  # turning on the spot is progress twice round, not for ever
ARC_STEP_M = 0.025  # between two places of the robot on an arc
TURN_RATE_MAX_RADPS = 1.0  # of any command; a sharper bend is driven slower


@dataclass(frozen=True)
class Pace:
    """How far and how fast one command may go.

    speed_mps: forward speed. step_m: path length of one command. turn_step_rad: most turning in one command.
    lookahead_m: distance along the path of the point that is steered for. pivot_above_rad: heading error above which
    the robot turns before it drives. arc_radius_m: radius of such turns; 0 is a turn on the spot.
    cut_m: how far the chord to that point may leave the path.
    """

    speed_mps: float = 0.5
    step_m: float = 0.2
    turn_step_rad: float = np.radians(10.0)
    lookahead_m: float = 0.45
    pivot_above_rad: float = np.radians(25.0)
    arc_radius_m: float = 0.0
    cut_m: float = 0.03


def closest_on_path(points_m: np.ndarray, at_m: np.ndarray) -> tuple[float, np.ndarray]:
    """(arc length in metres, point) of the place on the polyline `points_m` (N, 2) that is nearest to `at_m` (2,)."""
    start, run = points_m[:-1], np.diff(points_m, axis=0)
    length = np.linalg.norm(run, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(length > 0, np.einsum("ij,ij->i", at_m - start, run) / length**2, 0.0)
    t = np.clip(t, 0.0, 1.0)
    near = start + t[:, None] * run
    best = int(np.argmin(np.linalg.norm(near - at_m, axis=1)))
    return float(length[:best].sum() + t[best] * length[best]), near[best]


def points_at(points_m: np.ndarray, arc_m: np.ndarray) -> np.ndarray:
    """(K, 2) points at arc lengths `arc_m` (K,) along the polyline, its end beyond that."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])
    return np.stack([np.interp(arc_m, arc, points_m[:, 0]), np.interp(arc_m, arc, points_m[:, 1])], axis=1)


def ahead_on_path(points_m: np.ndarray, at_m: np.ndarray, length_m: float) -> np.ndarray:
    """(M, 2) the stretch of the polyline from the place nearest to `at_m` for `length_m` metres, sampled every 5 cm."""
    arc, _ = closest_on_path(points_m, at_m)
    total = float(np.linalg.norm(np.diff(points_m, axis=0), axis=1).sum())
    stations = np.arange(arc, min(arc + length_m, total) + 1e-9, 0.05)
    return points_at(points_m, stations)


def first_on_way(way: Path, things_m: np.ndarray, at_m: np.ndarray, near_m: float, *,
                 else_m: np.ndarray | None = None) -> np.ndarray:
    """(2,) of the things (K, 2) the first that lies within near_m of the way ahead of `at_m`; where there is no way, or none
    lies on it, else_m (2,), or without that the one nearest to `at_m`."""
    if way.found and len(way.points_m) >= 2:
        gaps = np.linalg.norm(things_m[:, None] - ahead_on_path(way.points_m, at_m, np.inf)[None], axis=2)
        barred = gaps.min(axis=0) < near_m
        if barred.any():
            return things_m[gaps[:, np.argmax(barred)].argmin()]
    if else_m is not None:
        return else_m
    return things_m[np.argmin(np.linalg.norm(things_m - at_m, axis=1))]


def short_of(way_m: np.ndarray, at_m: np.ndarray, thing_m: np.ndarray, stop_m: float) -> np.ndarray:
    """(M, 2) the stretch of the way (N, 2) from the place nearest to `at_m` up to stop_m before the thing (2,)."""
    ahead = ahead_on_path(way_m, at_m, np.inf)
    near = np.linalg.norm(ahead - thing_m, axis=1) < stop_m
    return ahead[:np.argmax(near)] if near.any() else ahead


def steer(path_m: np.ndarray, map_from_body: np.ndarray, pace: Pace) -> Twist:
    """The next command that follows `path_m` (N >= 2, 2) from the believed pose."""
    x, y, yaw = planar(map_from_body)
    here = np.array([x, y])
    target = target_on(path_m, here, pace)
    left = float(np.linalg.norm(path_m[-1] - here))
    error = float(wrap(np.arctan2(target[1] - y, target[0] - x) - yaw))
    if abs(error) > pace.pivot_above_rad:
        return turn(error, pace)
    distance = max(float(np.linalg.norm(target - here)), 1e-6)
    curvature = 2.0 * np.sin(error) / distance
    step = min(pace.step_m, max(left, 0.02))
    if abs(curvature) * step > pace.turn_step_rad:
        step = pace.turn_step_rad / abs(curvature)
    speed = min(pace.speed_mps, TURN_RATE_MAX_RADPS / max(abs(curvature), 1e-9))
    return Twist(speed, speed * curvature, step / speed)


def target_on(path_m: np.ndarray, here_m: np.ndarray, pace: Pace) -> np.ndarray:
    """(2,) the farthest point within the lookahead whose chord stays within pace.cut_m of the path."""
    arc, near = closest_on_path(path_m, here_m)
    stations = np.linspace(0.0, pace.lookahead_m, 10)[1:]
    way = np.concatenate([near[None], points_at(path_m, arc + stations)])
    for last in range(len(way) - 1, 2, -1):
        chord = way[last] - near
        length = np.linalg.norm(chord)
        if length > 0:
            side = np.abs(chord[0] * (way[:last, 1] - near[1]) - chord[1] * (way[:last, 0] - near[0])) / length
            if side.max() <= pace.cut_m:
                return way[last]
    return way[2]


def turn(angle_rad: float, pace: Pace) -> Twist:
    """One bounded step of a turn by `angle_rad`: on the spot, or on an arc of pace.arc_radius_m."""
    step = float(np.clip(angle_rad, -pace.turn_step_rad, pace.turn_step_rad))
    if pace.arc_radius_m <= 0.0:
        duration = max(abs(step) / TURN_RATE_MAX_RADPS, 0.05)
        return Twist(0.0, step / duration, duration)
    length = abs(step) * pace.arc_radius_m
    duration = length / pace.speed_mps
    return Twist(pace.speed_mps, step / duration, duration)


def turns(shares: Sequence[float], pace: Pace) -> list[Twist]:
    """Turns on the spot one after the other, left positive, in shares of the largest."""
    return [turn(share * pace.turn_step_rad, pace) for share in shares]


class Progress:
    """still: so many views on end the robot has not got on."""

    def __init__(self) -> None:
        self.still, self._turned_rad = 0, 0.0
        self._last: np.ndarray | None = None

    def note(self, pose: np.ndarray) -> bool:
        """Take the pose (3,) of a view: x, y, yaw. Whether it is more than 5 cm from the one before."""
        if self._last is None:
            self._last = pose
            return False
        shifted = bool(np.linalg.norm(pose[:2] - self._last[:2]) > 0.05)
        turned = abs(wrap(pose[2] - self._last[2]))
        self._turned_rad = 0.0 if shifted else self._turned_rad + turned
        self.still = 0 if shifted or (turned > 0.03 and self._turned_rad < MOST_TURNING_RAD) else self.still + 1
        self._last = pose
        return shifted


def arc(command: Twist, length_m: float) -> tuple[np.ndarray, np.ndarray]:
    """((M, 2) places of the robot's middle in its body frame now, (M,) metres of way) on the command's arc."""
    way = np.arange(ARC_STEP_M, length_m + ARC_STEP_M, ARC_STEP_M)
    sign = 1.0 if command.forward_mps >= 0 else -1.0
    curvature = command.turn_radps / command.forward_mps if command.forward_mps else 0.0
    turn = sign * way * curvature
    chord = sign * way * np.sinc(turn / (2.0 * np.pi))
    return np.stack([chord * np.cos(0.5 * turn), chord * np.sin(0.5 * turn)], axis=1), way
