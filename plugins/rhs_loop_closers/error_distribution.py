"""Loop closing by spreading the error of the end pose (thesis section 3.1.3, eq. 3.14).

As printed: e(t) = e_max (-1/2 + (1/M) integral_0^t |v|), M = integral_0^tmax |v|, for x and "the same for the
others": y, z and the three Euler angles, each with its own v. The weight runs from -1/2 at the start to +1/2 at the
end, so the loop closes, but every pose (the first one too) is also shifted by the constant -e_max / 2. The text
around it divides the final error through all the steps, and section 5.4 lets the first pose of the camera define the
origin of the world. Reading chosen: the first pose stays where it is, e(t) = e_max (1/M) integral_0^t |v|. Both
readings give maps that differ by that one constant.

Where an axis has not moved at all (M = 0, the height of a robot on the floor) its error is spread by the distance on
the floor. What lies before the earlier view of the loop is unchanged, what follows the later one moves with it.

`positions=printed` adds the corrections to positions and Euler angles independently, as the equation says. An error of
heading made half way has then long displaced the positions that follow, and spreading the end error over them in
proportion does not undo that: on drifting surveys the end is right and the middle no better than before. With
`positions=turned` (the default) the angles are corrected first, the same steps are walked again with the corrected
angles, and only the error of position that is left is spread by the equation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from rhs.api.contracts import Context
from rhs.api.geometry import inverse, wrap
from rhs.api.records import Closure, LoopEdge, View
from rhs.estimation.views.loops import closing_gap, covariances_of, ends_meet, poses_of, travelled_m
from rhs.estimation.views.settings import SightingSettings

from .config import ErrorDistribution

UNUSED = "not used: more key-points agree on another closure"


class ErrorSpreader:
    """Closes one loop: the last views against the first ones."""

    def __init__(self, settings: ErrorDistribution, context: Context) -> None:
        self._settings = settings
        self._rng = context.rng
        a = settings.advanced
        self._sighting = SightingSettings(settings.min_inliers, ratio=context.features.ratio, ransac=a.ransac,
                                          depth_share=a.depth_share)

    def close(self, views: Sequence[View]) -> Closure:
        """Find the end among the beginning, and divide the error through the steps between."""
        poses = poses_of(views)
        edges = ends_meet(
            views, reach=self._settings.reach_views, checks=self._settings.checks, settings=self._sighting,
            rng=self._rng,
        )  # fmt: skip
        judged = [self._judged(poses, edge) for edge in edges]
        used = next((edge for edge in judged if edge.accepted), None)
        unsure = covariances_of(views)
        if used is None:
            return Closure(poses, tuple(judged), {"closures": 0.0}, unsure)
        judged = [replace(edge, accepted=False, reason=UNUSED) if edge.accepted and edge is not used else edge
                  for edge in judged]  # fmt: skip
        corrected = spread(poses, used, turned=self._settings.positions == "turned")
        details = {"closures": 1.0, "closure_inliers": float(used.inliers)}
        return Closure(corrected, tuple(judged), details, bridged(unsure, travelled_m(poses), used))

    def _judged(self, poses: np.ndarray, edge: LoopEdge) -> LoopEdge:
        """The edge, refused if the odometry cannot have been that wrong."""
        distance_m = travelled_m(poses)
        way_m = distance_m[edge.later] - distance_m[edge.earlier]
        shift_m = float(np.linalg.norm(closing_gap(poses, edge)[:3, 3]))
        if shift_m <= self._settings.advanced.base_m + self._settings.max_drift_share * way_m:
            return edge
        reason = f"moves the end by {shift_m:.1f} m after {way_m:.1f} m of way"
        return replace(edge, accepted=False, reason=reason)


def spread(poses: np.ndarray, edge: LoopEdge, *, turned: bool = False) -> np.ndarray:
    """(N, 4, 4) poses with the error at `edge.later` divided over the way since `edge.earlier` (eq. 3.14).

    turned: walk the steps again with the corrected angles before spreading what is left of the position error.
    """
    first, last = edge.earlier, edge.later
    wanted = _coordinates((poses[first] @ edge.earlier_from_later)[None])[0]
    part = poses[first : last + 1]
    if turned:
        part = _walked_again(part, _corrected(part, wanted, slice(3, 6)))
    out = poses.copy()
    out[first : last + 1] = _corrected(part, wanted, slice(0, 6))
    out[first] = poses[first]
    out[last + 1 :] = out[last] @ inverse(poses[last]) @ poses[last + 1 :]
    return out


def bridged(unsure: np.ndarray, way_m: np.ndarray, edge: LoopEdge) -> np.ndarray:
    """(N, 6, 6) how unsure poses are that this loop holds at its end, from how unsure they were: as its earlier view, and of
    their own as much as there is way left to its later one (Brownian bridge), or way since."""
    first, last = edge.earlier, edge.later
    left = np.abs(way_m - way_m[last]) / np.maximum(np.maximum(way_m, way_m[last]) - way_m[first], 1e-9)
    out: np.ndarray = unsure[first] + unsure * left[:, None, None]
    out[:first] = unsure[:first]
    return out


def _corrected(poses: np.ndarray, wanted: np.ndarray, axes: slice) -> np.ndarray:
    """(N, 4, 4) poses whose coordinates `axes` end where `wanted` (6,) says, by eq. 3.14."""
    values = _coordinates(poses)
    error = np.zeros(6)
    error[axes] = (wanted - values[-1])[axes]
    error[3:] = wrap(error[3:])
    return _poses(values + error * _weights(values))


def _walked_again(poses: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """The steps of `poses` (N, 4, 4), each in its own body frame, walked with the rotations of `turned`."""
    steps = np.einsum("nji,nj->ni", poses[:-1, :3, :3], np.diff(poses[:, :3, 3], axis=0))
    out = turned.copy()
    out[0, :3, 3] = poses[0, :3, 3]
    out[1:, :3, 3] = poses[0, :3, 3] + np.cumsum(np.einsum("nij,nj->ni", turned[:-1, :3, :3], steps), axis=0)
    return out


def _coordinates(poses: np.ndarray) -> np.ndarray:
    """(N, 6) x, y, z metres and the Euler angles about x, y, z, radians, without jumps of a full turn."""
    angles = Rotation.from_matrix(poses[:, :3, :3]).as_euler("xyz")
    return np.hstack([poses[:, :3, 3], np.unwrap(angles, axis=0)])


def _poses(values: np.ndarray) -> np.ndarray:
    """Inverse of _coordinates."""
    out = np.tile(np.eye(4), (len(values), 1, 1))
    out[:, :3, :3] = Rotation.from_euler("xyz", values[:, 3:]).as_matrix()
    out[:, :3, 3] = values[:, :3]
    return out


def _weights(values: np.ndarray) -> np.ndarray:
    """(N, 6) share of each axis's way done so far, 0 at the first row and 1 at the last."""
    moved = np.abs(np.diff(values, axis=0))
    floor = np.linalg.norm(np.diff(values[:, :2], axis=0), axis=1)
    floor = floor if floor.sum() > 0 else np.ones(len(floor))
    still = moved.sum(axis=0) < 1e-9
    moved[:, still] = floor[:, None]
    done = np.vstack([np.zeros(6), np.cumsum(moved, axis=0)])
    return done / done[-1]
