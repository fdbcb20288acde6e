"""State of the corridor filter: a few constants, walls, and the window of recent poses, with their joint covariance.

Layout of the covariance: base (4) | planes (2 each) | clones (5 each, oldest first, the newest is the present pose).
base = speed m/s, turn rate rad/s (both used without motion input only), scale of the motion input, corridor width m.
plane = offset d m, small angle alpha rad. clone = x, y m, yaw, pitch, roll rad of the body in the map.

A plane of axis 0 is x = d - alpha (y - pivot), of axis 1 the same with x and y exchanged, of axis 2 z = d. So the map
axes are the directions of the building, and the right angles of the building are the smallness of alpha.
Sources: window of cloned poses from Mourikis and Roumeliotis 2007 (MSCKF); walls as states of their own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rhs.api.geometry import wrap
from rhs.estimation.filters.kalman import symmetric

BASE, PER_PLANE, PER_CLONE = 4, 2, 5
SPEED, TURN, SCALE, WIDTH = range(4)
BIN_M = 0.5


@dataclass(frozen=True, eq=False)
class Plane:
    """A wall (axis 0 or 1), floor or ceiling (axis 2). low_m, high_m: extent seen, along the wall. hits: tracks attached.
    paired: its distance to the opposite wall has been used once. support: hits per stretch
    of BIN_M along the wall, by number of the stretch. sides: tracks seen from where the coordinate across the wall is lower,
    and from where it is higher."""

    axis: int
    offset_m: float
    angle_rad: float
    pivot_m: float
    low_m: float
    high_m: float
    hits: int = 0
    paired: bool = False
    support: Mapping[int, int] = field(default_factory=dict)
    sides: tuple[int, int] = (0, 0)

    @property
    def is_floor(self) -> bool:
        return self.axis == 2

    @property
    def along(self) -> int:
        """The axis along it: of a wall the other one of the floor's."""
        return 0 if self.is_floor else 1 - self.axis

    @property
    def firm(self) -> set[int]:
        """The stretches along it with three hits or more."""
        return {k for k, n in self.support.items() if n >= 3}

    def normal(self) -> np.ndarray:
        """(3,) n with n . p = level() on the plane; not of unit length, but within alpha^2 of it."""
        n = np.zeros(3)
        n[self.axis] = 1.0
        if self.axis < 2:
            n[1 - self.axis] = self.angle_rad
        return n

    def level(self) -> float:
        return self.offset_m + self.angle_rad * self.pivot_m

    def at(self, along_m: Any) -> Any:
        """Offset of the wall at a coordinate, or many, along it."""
        return self.offset_m - self.angle_rad * (along_m - self.pivot_m)


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """What the motion model expects between two views, in the body frame half way round the turn.

    mean (3,): forward m, left m, turn rad. by_base (3, 4): derivative by the base states. noise (3, 3) covariance.
    base_noise (4,): variance added to the base states before the move."""

    mean: np.ndarray
    by_base: np.ndarray
    noise: np.ndarray
    base_noise: np.ndarray


class CorridorState:
    """Mean and covariance, and the few operations that change their size. Mutable on purpose: it lives in one filter."""

    def __init__(self, base: np.ndarray, base_sigma: np.ndarray, pose: np.ndarray, pose_sigma: np.ndarray) -> None:
        """base, base_sigma (4,); pose, pose_sigma (5,): the start pose and how well it is known."""
        self.base = np.array(base, float)
        self.planes: list[Plane] = []
        self.clones = np.array(pose, float)[None]
        self.covariance = np.diag(np.concatenate([base_sigma, pose_sigma]) ** 2)

    @property
    def window(self) -> int:
        return len(self.clones)

    @property
    def first_clone(self) -> int:
        return BASE + PER_PLANE * len(self.planes)

    def plane_slice(self, index: int) -> slice:
        return slice(BASE + PER_PLANE * index, BASE + PER_PLANE * (index + 1))

    def clone_slice(self, index: int) -> slice:
        start = self.first_clone + PER_CLONE * (index % self.window)
        return slice(start, start + PER_CLONE)

    def pose_covariance(self) -> np.ndarray:
        """(5, 5) covariance of the newest clone."""
        block = self.clone_slice(-1)
        return self.covariance[block, block]

    def append_clone(self, motion: BodyMotion, tilt_sigma_rad: float) -> None:
        """Move: the new clone follows from the newest one; pitch and roll are drawn afresh."""
        x, y, yaw = self.clones[-1, :3]
        forward, left, turn = motion.mean
        c, s = np.cos(yaw + 0.5 * turn), np.sin(yaw + 0.5 * turn)
        new = np.array([x + c * forward - s * left, y + s * forward + c * left, wrap(yaw + turn), 0.0, 0.0])
        by_yaw = np.array([-s * forward - c * left, c * forward - s * left, 1.0])
        by_motion = np.array([[c, -s, 0.5 * by_yaw[0]], [s, c, 0.5 * by_yaw[1]], [0.0, 0.0, 1.0]])
        self.covariance[range(BASE), range(BASE)] += motion.base_noise
        jacobian = np.zeros((PER_CLONE, len(self.covariance)))
        jacobian[:3, :BASE] = by_motion @ motion.by_base
        last = self.clone_slice(-1).start
        jacobian[:2, last : last + 2] = np.eye(2)
        jacobian[:3, last + 2] = by_yaw
        noise = np.diag([0.0, 0.0, 0.0, tilt_sigma_rad**2, tilt_sigma_rad**2])
        noise[:3, :3] = by_motion @ motion.noise @ by_motion.T
        cross = jacobian @ self.covariance
        self.covariance = symmetric(np.block([[self.covariance, cross.T], [cross, cross @ jacobian.T + noise]]))
        self.clones = np.vstack([self.clones, new])

    def drop_oldest_clone(self) -> np.ndarray:
        """Marginalise the oldest pose out of the window; returns it (5,)."""
        block = self.clone_slice(0)
        oldest, self.clones = self.clones[0], self.clones[1:]
        self.covariance = np.delete(np.delete(self.covariance, block, 0), block, 1)
        return oldest

    def forget(self, index: int, value: float, sigma: float) -> None:
        """A constant of the base is as unknown as at the start, and has nothing to do with anything else."""
        self.base[index] = value
        self.covariance[index], self.covariance[:, index] = 0.0, 0.0
        self.covariance[index, index] = sigma**2

    def add_plane(self, plane: Plane, sigma: tuple[float, float]) -> None:
        """A new wall, at first independent of all else; sigma: of its offset (m) and its angle (rad)."""
        at = self.first_clone
        wider = np.insert(np.insert(self.covariance, [at, at], 0.0, axis=0), [at, at], 0.0, axis=1)
        wider[[at, at + 1], [at, at + 1]] = np.square(sigma)
        self.covariance, self.planes = wider, [*self.planes, plane]

    def remove_plane(self, index: int) -> None:
        block = self.plane_slice(index)
        self.covariance = np.delete(np.delete(self.covariance, block, 0), block, 1)
        self.planes = self.planes[:index] + self.planes[index + 1 :]

    def apart(self, i: int, j: int, along_m: float) -> tuple[float, np.ndarray]:
        """By how much wall i lies further out than wall j at a coordinate along both, and its (D,) derivative."""
        a, b, row = self.planes[i], self.planes[j], np.zeros(len(self.covariance))
        at_a, at_b = self.plane_slice(i).start, self.plane_slice(j).start
        row[[at_a, at_a + 1, at_b, at_b + 1]] = 1.0, -(along_m - a.pivot_m), -1.0, along_m - b.pivot_m
        return a.at(along_m) - b.at(along_m), row

    def add(self, delta: np.ndarray, covariance: np.ndarray) -> None:
        """Take over a correction: delta (n,) in the layout of the covariance."""
        self.base = self.base + delta[:BASE]
        walls = delta[BASE : self.first_clone].reshape(-1, PER_PLANE)
        self.planes = [
            replace(p, offset_m=p.offset_m + float(d), angle_rad=p.angle_rad + float(a))
            for p, (d, a) in zip(self.planes, walls, strict=True)
        ]
        self.clones = self.clones + delta[self.first_clone :].reshape(-1, PER_CLONE)
        self.covariance = covariance

    def carried(self, delta: np.ndarray) -> np.ndarray:
        """The covariance after a correction delta (n,) that was added, where nothing tells the heading of the whole: a turn
        of all poses moves each from where it is believed now, not from where it was believed before. Else the next views
        seem to tell that turn (Huang, Mourikis and Roumeliotis 2010); so it is in a filter with invariant errors (Barrau and
        Bonnabel 2017)."""
        carry, moved = np.eye(len(delta)), delta[self.first_clone :].reshape(-1, PER_CLONE)
        x = self.first_clone + PER_CLONE * np.arange(self.window)
        carry[x, x + 2], carry[x + 1, x + 2] = -moved[:, 1], moved[:, 0]
        return symmetric(carry @ self.covariance @ carry.T)

    def rescale(self, factor: float, centre: np.ndarray) -> None:
        """Similarity about the (3,) point `centre` of the map: every length in the state is multiplied by `factor`.

        Heights, too: `centre` lies at the height of the camera. Angles and the corridor width stay (the width is what
        the scale is taken from)."""
        scale = np.ones(len(self.covariance))
        scale[[SPEED, SCALE]] = factor
        self.base[[SPEED, SCALE]] *= factor
        self.clones[:, :2] = centre[:2] + factor * (self.clones[:, :2] - centre[:2])
        moved = []
        for i, p in enumerate(self.planes):
            scale[self.plane_slice(i).start] = factor
            along = centre[1 - p.axis] if p.axis < 2 else 0.0
            moved.append(_similar(p, factor, along, centre[p.axis]))
        self.planes = moved
        for i in range(self.window):
            start = self.clone_slice(i).start
            scale[start : start + 2] = factor
        self.covariance = self.covariance * np.outer(scale, scale)


def _similar(p: Plane, factor: float, along: float, across: float) -> Plane:
    """The plane after a similarity about a point with these coordinates along and across it."""

    def moved(value: float, about: float) -> float:
        return about + factor * (value - about)

    return replace(
        p,
        offset_m=moved(p.offset_m, across),
        pivot_m=moved(p.pivot_m, along),
        low_m=moved(p.low_m, along),
        high_m=moved(p.high_m, along),
        support={int(np.floor(moved((k + 0.5) * BIN_M, along) / BIN_M)): n for k, n in p.support.items()},
    )
