"""Triangulation of tracks from a window of poses: as free points, or as points of a plane. All tracks at once.

A point is anchored at the camera centre that saw it last: azimuth, elevation (map axes) and inverse distance
(Civera, Davison and Montiel 2008), which stays well behaved for points far away. A point of a plane has azimuth and
elevation only; its inverse distance follows from the plane. The anchor is a constant, not a state.

Shapes: T tracks, N poses of the window. rays (T, N, 2): x/z, y/z in the camera frame; seen (T, N) bool.
Lengths of residuals are in units of rays; divide by `sigma` (noise / focal length) to get standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .kernels import BEHIND, free_points, points_on_planes
from .state import Plane

RHO_GUESSES = (0.02, 0.06, 0.12, 0.2, 0.35, 0.6, 1.0, 1.8)  # 1/m: 50 m to 0.55 m


@dataclass(frozen=True, eq=False)
class WindowCameras:
    """The window as cameras. rotation (N, 3, 3) map_from_camera, centre (N, 3), body (N, 3) origin of the body,
    axes (N, 3, 3): columns are the map axes about which yaw, pitch and roll turn the body."""

    rotation: np.ndarray
    centre: np.ndarray
    body: np.ndarray
    axes: np.ndarray


@dataclass(frozen=True, eq=False)
class TrackFit:
    """angles (T, 2) azimuth and elevation, rho (T,) 1/m, anchor (T, 3); rho_sigma (T,) 1/m; cost (T,) sum of squares in
    units of sigma; good (T,) the point lies in front of all cameras that saw it."""

    angles: np.ndarray
    rho: np.ndarray
    anchor: np.ndarray
    rho_sigma: np.ndarray
    cost: np.ndarray
    good: np.ndarray

    def directions(self) -> np.ndarray:
        return _direction(self.angles)

    def points(self) -> np.ndarray:
        """(T, 3) in the map."""
        return self.anchor + self.directions() / self.rho[:, None]


def cameras_of(clones: np.ndarray, body_from_camera: np.ndarray) -> WindowCameras:
    """Cameras of the (N, 5) poses x, y, yaw, pitch, roll."""
    yaw, pitch, roll = clones[:, 2], clones[:, 3], clones[:, 4]
    rz, ry, rx = _turns(yaw, 2), _turns(pitch, 1), _turns(roll, 0)
    tilt = rz @ ry
    body_rotation = tilt @ rx
    body = np.concatenate([clones[:, :2], np.zeros((len(clones), 1))], axis=1)
    axes = np.stack([np.broadcast_to([0.0, 0.0, 1.0], body.shape), rz[:, :, 1], tilt[:, :, 0]], axis=2)
    centre = body + body_rotation @ body_from_camera[:3, 3]
    return WindowCameras(body_rotation @ body_from_camera[:3, :3], centre, body, axes)


def _turns(angle: np.ndarray, axis: int) -> np.ndarray:
    """(N, 3, 3) rotations about a coordinate axis."""
    out = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i] = np.sin(angle)
    out[:, i, j] = -out[:, j, i]
    return out


def _direction(angles: np.ndarray) -> np.ndarray:
    """(T, 3) unit vectors."""
    ca, sa, ce, se = np.cos(angles[:, 0]), np.sin(angles[:, 0]), np.cos(angles[:, 1]), np.sin(angles[:, 1])
    return np.stack([ce * ca, ce * sa, se], axis=1)


def _direction_jacobian(angles: np.ndarray) -> np.ndarray:
    """(T, 3, 2) derivative of the direction by azimuth and elevation."""
    ca, sa, ce, se = np.cos(angles[:, 0]), np.sin(angles[:, 0]), np.cos(angles[:, 1]), np.sin(angles[:, 1])
    return np.stack([np.stack([-ce * sa, ce * ca, 0 * ca], 1), np.stack([-se * ca, -se * sa, ce], 1)], axis=2)


def last_seen(seen: np.ndarray) -> np.ndarray:
    """(T,) index of the last pose that saw each track."""
    return seen.shape[1] - 1 - np.argmax(seen[:, ::-1], axis=1)


def start_angles(cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2) azimuth and elevation of the last ray, and its origin (T, 3): the anchor."""
    t, last = np.arange(len(rays)), last_seen(seen)
    ray = np.concatenate([rays[t, last], np.ones((len(rays), 1))], axis=1)
    d = np.einsum("tij,tj->ti", cameras.rotation[last], ray)
    angles = np.stack([np.arctan2(d[:, 1], d[:, 0]), np.arctan2(d[:, 2], np.hypot(d[:, 0], d[:, 1]))], axis=1)
    return angles, cameras.centre[last]


def seen_from(cameras: WindowCameras, angles: np.ndarray, rho: np.ndarray, anchor: np.ndarray):
    """(q (T, N, 3), p (T, N, 3)): vector camera to point times rho, in map axes and in camera axes."""
    q = rho[:, None, None] * (anchor[:, None] - cameras.centre[None]) + _direction(angles)[:, None]
    return q, np.einsum("nji,tnj->tni", cameras.rotation, q)


def residuals(p: np.ndarray, rays: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(T, N, 2) measured minus predicted ray, 0 where not seen."""
    z = np.maximum(p[..., 2:], BEHIND)
    return np.where(seen[..., None], rays - p[..., :2] / z, 0.0)


def by_camera_point(p: np.ndarray) -> np.ndarray:
    """(T, N, 2, 3) derivative of the predicted ray by the point in camera axes."""
    z = np.maximum(p[..., 2], BEHIND)
    out = np.zeros((*p.shape[:2], 2, 3))
    out[..., 0, 0] = out[..., 1, 1] = 1.0 / z
    out[..., 0, 2], out[..., 1, 2] = -p[..., 0] / z**2, -p[..., 1] / z**2
    return out


def by_point(cameras: WindowCameras, angles: np.ndarray, anchor: np.ndarray, camera_jacobian: np.ndarray) -> np.ndarray:
    """(T, N, 2, 3) derivative of the predicted ray by azimuth, elevation and inverse distance."""
    by_map = camera_jacobian @ np.swapaxes(cameras.rotation, 1, 2)[None]
    turn = np.einsum("tnij,tjk->tnik", by_map, _direction_jacobian(angles))
    along = np.einsum("tnij,tnj->tni", by_map, anchor[:, None] - cameras.centre[None])
    return np.concatenate([turn, along[..., None]], axis=3)


def plane_rho(planes: list[Plane], angles: np.ndarray, anchor: np.ndarray):
    """Inverse distance at which each track's ray meets its plane (one per track), and its derivatives.

    Returns rho (T,), by_angles (T, 2), by_plane (T, 2) (offset, angle)."""
    n = np.stack([p.normal() for p in planes])
    d = _direction(angles)
    towards = (n * d).sum(1)
    gap = np.array([p.level() for p in planes]) - (n * anchor).sum(1)
    gap = np.where(np.abs(gap) < 1e-6, 1e-6, gap)
    rho = towards / gap
    by_angles = np.einsum("ti,tij->tj", n, _direction_jacobian(angles)) / gap[:, None]
    other = np.array([1 - p.axis if p.axis < 2 else 0 for p in planes])
    upright = np.array([p.axis < 2 for p in planes])
    t, pivot = np.arange(len(planes)), np.array([p.pivot_m for p in planes])
    by_angle = (d[t, other] - rho * (pivot - anchor[t, other])) / gap
    return rho, by_angles, np.stack([-rho / gap, np.where(upright, by_angle, 0.0)], axis=1)


def fit_free(cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray, sigma: float, iterations: int = 8) -> TrackFit:
    """Least-squares points: best of a few distances along the last ray, then Levenberg-Marquardt."""
    angles, anchor = start_angles(cameras, rays, seen)
    x, cost, spread = free_points(*_plain(cameras, rays, seen), anchor, angles, np.array(RHO_GUESSES), iterations)
    rho = np.where(np.abs(x[:, 2]) < 1e-6, 1e-6, x[:, 2])
    return TrackFit(x[:, :2], rho, anchor, sigma * np.sqrt(spread), cost / sigma**2, _in_front(cameras, x, anchor, seen))


def fit_on_planes(
    cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray, sigma: float, planes: list[Plane], iterations: int = 4
) -> TrackFit:
    """Least-squares points that lie on the given planes (one per track), Gauss-Newton in azimuth and elevation."""
    angles, anchor = start_angles(cameras, rays, seen)
    normals, levels = np.stack([p.normal() for p in planes]), np.array([p.level() for p in planes])
    x, cost = points_on_planes(*_plain(cameras, rays, seen), anchor, angles, normals, levels, iterations)
    good = _in_front(cameras, x, anchor, seen) & (x[:, 2] > 1e-3)
    return TrackFit(x[:, :2], x[:, 2], anchor, np.zeros(len(rays)), cost / sigma**2, good)


def _plain(
    cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The arrays of the compiled loops, each in one piece."""
    rotation, centre, rays, seen = (np.ascontiguousarray(a) for a in (cameras.rotation, cameras.centre, rays, seen))
    return rotation, centre, rays, seen


def _in_front(cameras, x, anchor, seen):
    _, p = seen_from(cameras, x[:, :2], x[:, 2], anchor)
    return (np.where(seen, p[..., 2], 1.0) > 0.02).all(axis=1)
