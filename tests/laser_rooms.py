"""A laser on wheels in hand-made rooms of straight walls: scans by exact geometry, and where the robot truly was."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera, se2
from rhs.api.records import Observation, Scan, View
from rhs.estimation.scans.planar_poses import between

CAMERA = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)
BEARINGS = np.radians(np.linspace(-90.0, 90.0, 181))
MAX_M = 30.0
NOISE_M = 0.01


def box(west, south, east, north):
    """Four walls (4, 2, 2)."""
    a, b, c, d = (west, south), (east, south), (east, north), (west, north)
    return np.array([[a, b], [b, c], [c, d], [d, a]], float)


def scan_at(walls, pose, rng, *, noise_m=NOISE_M):
    """What the laser sees of walls (W, 2, 2) from a pose (3,)."""
    angle = BEARINGS + pose[2]
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None]
    start, along = walls[None, :, 0] - pose[None, None, :2], (walls[:, 1] - walls[:, 0])[None]
    cross = ray[..., 0] * along[..., 1] - ray[..., 1] * along[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0]) / cross
        share = (start[..., 0] * ray[..., 1] - start[..., 1] * ray[..., 0]) / cross
    reach = np.where((reach > 0) & (share >= 0) & (share <= 1), reach, np.inf).min(axis=1)
    reach = np.where(reach > MAX_M, np.inf, np.maximum(reach + noise_m * rng.standard_normal(len(reach)), 0.01))
    return Scan(BEARINGS, reach, MAX_M)


def drive(corners, *, step_m=0.15, step_rad=0.15):
    """(N, 3) poses along straight lines between corners (K, 2), turning on the spot at each."""
    poses, yaw = [], None
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        a, b = np.asarray(a, float), np.asarray(b, float)
        heading = np.arctan2(*(b - a)[::-1])
        if yaw is not None:
            turn = (heading - yaw + np.pi) % (2.0 * np.pi) - np.pi
            shares = np.linspace(0.0, 1.0, max(int(abs(turn) / step_rad), 1), endpoint=False)
            poses += [[*a, yaw + share * turn] for share in shares]
        yaw = heading
        count = max(int(np.hypot(*(b - a)) / step_m), 1)
        poses += [[*(a + share * (b - a)), yaw] for share in np.linspace(0.0, 1.0, count, endpoint=False)]
    return np.array(poses)


def observed(walls, poses, *, seed=0, wheels=None):
    """Observations at poses (N, 3). wheels (N, 3): their readings; None: true; `none`: there are no wheels."""
    rng = np.random.default_rng(seed)
    true = np.vstack([np.zeros(3), between(poses[:-1], poses[1:])])
    readings = true if wheels is None or isinstance(wheels, str) else wheels
    return [Observation(k, 0.2 * k, CAMERA, scan=scan_at(walls, pose, rng),
                        wheel=None if k == 0 or isinstance(wheels, str) else readings[k]) for k, pose in enumerate(poses)]


def true_wheels(poses):
    """(N, 3) what perfect wheels would read."""
    return np.vstack([np.zeros(3), between(poses[:-1], poses[1:])])


def views_of(observations, motions, poses):
    """A survey for loop closers: believed poses (N, 3)."""
    return tuple(View(o.index, o.stamp_s, o.camera, m, se2(*p), 1e-6 * np.eye(6), o.scan, None)
                 for o, m, p in zip(observations, motions, poses, strict=True))
