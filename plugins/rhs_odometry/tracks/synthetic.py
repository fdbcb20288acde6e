"""Tracks without pictures: points on walls, floor and ceiling of a floor plan, seen along a path, with noise.

Serves the tests and the replay: a lap takes a second. Noise has a white part and a part that stays with the track, as
patches followed from view to view have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, camera_from_fov, inverse, se2, transform, wrap

from .track_frames import TrackFrame, Tracks


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """Walls (S, 2, 2) as segments in metres, floor at 0, ceiling_m."""

    walls: np.ndarray
    ceiling_m: float = 2.5


@dataclass(frozen=True)
class TrackNoise:
    """Pixel noise: white per view, and a walk per view along the track; chance to lose a track; points followed."""

    white_px: float = 0.2
    walk_px: float = 0.05
    loss: float = 0.02
    points: int = 130


@dataclass(frozen=True)
class DriveNoise:
    """How the command differs from the motion: constant scale and share of turns per run, and noise per step."""

    scale: float = 1.05
    turn_scale: float = 1.02
    forward: float = 0.02
    turn: float = 0.05
    turn_rad: float = 0.003


def straight_plan(length_m: float = 14.0, width_m: float = 2.0) -> FloorPlan:
    """A corridor along x from (-2, 0) with its axis on y = 0, open at both ends."""
    h = 0.5 * width_m
    return FloorPlan(np.array([[[-2.0, h], [length_m, h]], [[-2.0, -h], [length_m, -h]]]))


def square_plan(side_m: float = 20.0, width_m: float = 2.0) -> FloorPlan:
    """Four corridors round a block: outer square from (0, 0), inner square `width_m` inside."""

    def ring(a: float, b: float):
        c = np.array([[a, a], [b, a], [b, b], [a, b]])
        return np.stack([c, np.roll(c, -1, axis=0)], axis=1)

    return FloorPlan(np.concatenate([ring(0.0, side_m), ring(width_m, side_m - width_m)]))


def corridor_path(corners: np.ndarray, step_m: float = 0.125, *, radius_m: float = 0.7, turn_step_m: float = 0.08):
    """(N, 3) poses along the (C, 2) corners. radius_m > 0: arcs of that radius; 0: turns on the spot of 6 degrees."""
    poses = [np.array([*corners[0], _heading(corners[0], corners[1])])]
    for i in range(1, len(corners)):
        last = i == len(corners) - 1
        cut = 0.0 if last else radius_m
        start, heading = poses[-1].copy(), poses[-1][2]
        length = float(np.linalg.norm(corners[i] - start[:2])) - cut
        for k in range(1, int(round(length / step_m)) + 1):
            poses.append(start + [*(k * step_m * np.array([np.cos(heading), np.sin(heading)])), 0.0])
        if not last:
            turn = float(wrap(_heading(corners[i], corners[i + 1]) - heading))
            poses.extend(_turn(poses[-1], turn, radius_m, turn_step_m))
    return np.array(poses)


def _heading(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arctan2(b[1] - a[1], b[0] - a[0]))


def _turn(start: np.ndarray, turn: float, radius_m: float, step_m: float) -> list[np.ndarray]:
    steps = int(np.ceil(abs(turn) * radius_m / step_m)) if radius_m > 0 else int(np.ceil(abs(turn) / np.radians(6)))
    out, side = [], np.sign(turn)
    centre = start[:2] + side * radius_m * np.array([-np.sin(start[2]), np.cos(start[2])])
    for k in range(1, steps + 1):
        yaw = start[2] + turn * k / steps
        out.append(np.array([*(centre + side * radius_m * np.array([np.sin(yaw), -np.cos(yaw)])), yaw]))
    return out


def scatter(plan: FloorPlan, per_m2: float, rng: np.random.Generator) -> np.ndarray:
    """(M, 3) points at random on the walls, and on floor and ceiling between the walls' bounds."""
    parts = []
    for a, b in plan.walls:
        n = int(np.linalg.norm(b - a) * plan.ceiling_m * per_m2)
        along, up = rng.uniform(size=n), rng.uniform(0.0, plan.ceiling_m, n)
        parts.append(np.column_stack([a + along[:, None] * (b - a), up]))
    low, high = plan.walls.reshape(-1, 2).min(0), plan.walls.reshape(-1, 2).max(0)
    for z in (0.0, plan.ceiling_m):
        n = int(np.prod(high - low) * per_m2)
        parts.append(np.column_stack([rng.uniform(low, high, (n, 2)), np.full(n, z)]))
    return np.concatenate(parts)


def hidden(eye: np.ndarray, points: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """(M,) bool: a wall stands between the eye (2,) and the point (M, 2)."""
    out, d = np.zeros(len(points), bool), points - eye
    for a, b in walls:
        w, from_eye = b - a, a - eye
        det = d[:, 0] * -w[1] + d[:, 1] * w[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (from_eye[0] * -w[1] + from_eye[1] * w[0]) / det
            u = (d[:, 0] * from_eye[1] - d[:, 1] * from_eye[0]) / det
        out |= (t > 0.0) & (t < 0.999) & (u > 0.0) & (u < 1.0)
    return out


class Imager:
    """Sees points from poses and keeps following the same ones while it can."""

    def __init__(self, plan: FloorPlan, points: np.ndarray, camera: Camera, noise: TrackNoise) -> None:
        self._plan, self._points, self._camera, self._noise = plan, points, camera, noise
        self._follow = np.zeros(0, int)  # indices into points
        self._ids, self._walk, self._next = np.zeros(0, np.int64), np.zeros((0, 2)), 0

    def see(self, pose: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """(ids, pixels) of the followed points from the (3,) or 4x4 body pose."""
        body = se2(*pose) if pose.shape == (3,) else pose
        camera_from_map = inverse(body @ self._camera.body_from_camera)
        pixels, visible = self._visible(camera_from_map)
        keep = visible[self._follow] & (rng.uniform(size=len(self._follow)) > self._noise.loss)
        self._follow, self._ids, self._walk = self._follow[keep], self._ids[keep], self._walk[keep]
        visible[self._follow] = False
        fresh = np.flatnonzero(visible)
        fresh = rng.permutation(fresh)[: max(0, self._noise.points - len(self._follow))]
        self._follow = np.concatenate([self._follow, fresh])
        self._ids = np.concatenate([self._ids, self._next + np.arange(len(fresh))])
        self._next += len(fresh)
        self._walk = np.vstack([self._walk, np.zeros((len(fresh), 2))])
        self._walk = self._walk + self._noise.walk_px * rng.standard_normal(self._walk.shape)
        noise = self._walk + self._noise.white_px * rng.standard_normal(self._walk.shape)
        return self._ids.copy(), pixels[self._follow] + noise

    def _visible(self, camera_from_map: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        c = self._camera
        local = transform(camera_from_map, self._points)
        pixels = c.project(local)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= 2).all(1) & (pixels[:, 0] < c.width - 3) & (pixels[:, 1] < c.height - 3)
        inside &= (local[:, 2] > 0.3) & (local[:, 2] < 12.0)
        eye = inverse(camera_from_map)[:2, 3]
        seen = np.flatnonzero(inside)
        inside[seen[hidden(eye, self._points[seen, :2], self._plan.walls)]] = False
        return pixels, inside


def drive(path: np.ndarray, noise: DriveNoise, rng: np.random.Generator, step_s: float = 0.25) -> np.ndarray:
    """(N, 3) commands (forward m, turn rad, s) that a robot that is to follow the (N, 3) path would have been given."""
    move = np.diff(path, axis=0, prepend=path[:1])
    forward, turn = np.hypot(move[:, 0], move[:, 1]), wrap(move[:, 2])
    given = np.column_stack([forward, turn, np.full(len(path), step_s)])
    given[:, 0] *= noise.scale * (1 + noise.forward * rng.standard_normal(len(path)))
    given[:, 1] *= noise.turn_scale * (1 + noise.turn * rng.standard_normal(len(path)))
    given[1:, 1] += noise.turn_rad * rng.standard_normal(len(path) - 1)
    return given


def synthetic_tracks(
    plan: FloorPlan, path: np.ndarray, rng: np.random.Generator, *, track: TrackNoise | None = None,
    driving: DriveNoise | None = None,
) -> Tracks:
    """The tracks a 320x240 camera at 1.2 m height would give along the (N, 3) path."""
    camera = camera_from_fov(320, 240, 57.0, height_m=1.2)
    given = drive(path, driving or DriveNoise(), rng)
    imager = Imager(plan, scatter(plan, 6.0, rng), camera, track or TrackNoise())
    frames = []
    for i, pose in enumerate(path):
        ids, pixels = imager.see(pose, rng)
        frames.append(TrackFrame(0.25 * i, ids, pixels, given[i], given[i] * [1.0, 0.0, 0.0] + [0, 0, given[i][1]]))
    return Tracks(camera, path[0].copy(), frames, np.stack([se2(*p) for p in path]))


def square_corners(side_m: float = 20.0, width_m: float = 2.0, *, clockwise: bool = False) -> np.ndarray:
    """Corners of the centre line, starting and ending on the first side, two metres after the corner."""
    a, b = 0.5 * width_m, side_m - 0.5 * width_m
    ring: Sequence = [(a + 2.0, a), (b, a), (b, b), (a, b), (a, a), (a + 2.0, a)]
    corners = np.array(ring)
    return corners[:, ::-1].copy() if clockwise else corners


def named_tracks(name: str) -> Tracks:
    """Tracks by name: straight, corner or square, with an optional `:seed`. Raises ConfigError for another name."""
    plan, _, seed = name.partition(":")
    paths = {
        "straight": (straight_plan(), np.array([[0.0, 0.0], [10.0, 0.0]])),
        "corner": (square_plan(), np.array([[3.0, 1.0], [19.0, 1.0], [19.0, 10.0]])),
        "square": (square_plan(), square_corners()),
    }
    if plan not in paths or not (seed.isdigit() or not seed):
        raise ConfigError(f"synthetic:{name} is not one of {', '.join(paths)}, with a seed like synthetic:square:3")
    walls, corners = paths[plan]
    return synthetic_tracks(walls, corridor_path(corners), np.random.default_rng(int(seed or 0)))
