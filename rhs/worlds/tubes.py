"""The inside of tubes: where rays meet the wall, and the wall opened flat.

A tube is a section (round, or a rectangle) swept along a centre line of straight pieces and arcs that all lie in one
horizontal plane. A point of the wall has two numbers: `along_m`, the length of the centre line up to its section, and
`around_m`, the length along the edge of the section from the floor's middle, over the right wall, the ceiling and the
left wall. Section axes: x along, y left, z up. Angles and lengths in radians and metres.

Source: thesis sections 4.2 and 4.3 (tubular structure, dewarping). Deviation: where the thesis gives a mosaic the camera's
angle and depth as axes, here it has the section's own, so that mosaics of different cameras lie on one another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from rhs.api.errors import ConfigError, check_range
from rhs.api.geometry import arc, se2, se3, transform

TRACE_STEPS = 60  # of sphere tracing and the secant; grazing rays need the most
SPHERES = 6  # the first steps go no further than is surely free
TOUCHING = 1e-5  # so near the wall counts as on it, share of the section's size
ENDS_M = 1e3  # a tube goes straight on for so far before its first piece and behind its last


def check_pieces(pieces: Sequence[float], size_m: float, *, least_m: float) -> None:
    """Refuse a centre line that is not metres of a piece and its bend in degrees, one after the other, or bends more tightly
    than one and a half sizes. Raises ConfigError, naming `pieces`."""
    if len(pieces) % 2:
        raise ConfigError(f"pieces={list(pieces)} has {len(pieces)} numbers; expected pairs of metres and degrees, for "
                          "example [1,0,2,30]")
    for length_m, bend_deg in zip(pieces[::2], pieces[1::2], strict=True):
        check_range("", "pieces (length)", length_m, low=least_m, high=1000.0, unit="m")
        tightest = 57.29578 * length_m / (1.5 * size_m)
        check_range("", "pieces (bend)", bend_deg, low=-tightest, high=tightest, unit="degrees")


class Section(Protocol):
    """The edge of a tube's section."""

    size_m: float

    @property
    def perimeter_m(self) -> float: ...

    def slack(self, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        """Distance to the wall of points inside; negative outside."""
        ...

    def around(self, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        """around_m in [0, perimeter) of the wall seen from the middle through these points."""
        ...

    def wall(self, around_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """left and up of points of the wall."""
        ...


@dataclass(frozen=True)
class RoundSection:
    """A circle of radius `size_m`."""

    size_m: float

    @property
    def perimeter_m(self) -> float:
        return 2.0 * np.pi * self.size_m

    def slack(self, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        slack: np.ndarray = self.size_m - np.hypot(left, up)
        return slack

    def around(self, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        around: np.ndarray = np.mod(np.arctan2(-left, -up), 2.0 * np.pi) * self.size_m
        return around

    def wall(self, around_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = np.asarray(around_m) / self.size_m
        return -self.size_m * np.sin(angle), -self.size_m * np.cos(angle)


@dataclass(frozen=True)
class RectangularSection:
    """A rectangle of half width `size_m` and half height `size_m * aspect`."""

    size_m: float
    aspect: float = 1.0

    @property
    def half_height_m(self) -> float:
        return self.size_m * self.aspect

    @property
    def perimeter_m(self) -> float:
        return 4.0 * (self.size_m + self.half_height_m)

    def slack(self, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        slack: np.ndarray = np.minimum(self.size_m - np.abs(left), self.half_height_m - np.abs(up))
        return slack

    def around(self, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        a, b = self.size_m, self.half_height_m
        grow = np.maximum(np.maximum(np.abs(left) / a, np.abs(up) / b), 1e-12)
        y, z = left / grow, up / grow  # on the edge
        side = np.abs(left) / a >= np.abs(up) / b
        around: np.ndarray = np.where(side, np.where(y < 0, a + (z + b), 3 * a + 2 * b + (b - z)),
                                      np.where(z < 0, -y, a + 2 * b + (y + a)))
        around = np.mod(around, self.perimeter_m)
        return around

    def wall(self, around_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = self.size_m, self.half_height_m
        ends = np.array([0.0, a, a + 2 * b, 3 * a + 2 * b, 3 * a + 4 * b, self.perimeter_m])
        u = np.mod(around_m, self.perimeter_m)
        return (np.interp(u, ends, [0.0, -a, -a, a, a, 0.0]), np.interp(u, ends, [-b, -b, b, b, -b, -b]))


@dataclass(frozen=True, eq=False)
class Tube:
    """A section along pieces of a centre line: (length m, curvature 1/m, positive to the left), from the origin along x.

    Before the first piece and after the last the tube goes straight on."""

    section: RoundSection | RectangularSection
    pieces: tuple[tuple[float, float], ...] = ()

    @cached_property
    def spans(self) -> tuple[Span, ...]:
        """The pieces with where they start, and the straight ends before and behind them."""
        before, pose = se3(np.eye(3), np.array([-ENDS_M, 0.0, 0.0])), np.eye(4)
        out, start = [Span(-ENDS_M, ENDS_M if self.pieces else 2 * ENDS_M, 0.0, before)], 0.0
        for length_m, bend in self.pieces:
            out.append(Span(start, length_m, bend, pose))
            start, pose = start + length_m, along(pose, length_m, bend)
        return (*out, Span(start, ENDS_M, 0.0, pose)) if self.pieces else tuple(out)

    def pose(self, along_m: float) -> np.ndarray:
        """4x4 tube_from_section: where the section at `along_m` stands."""
        span = next(s for s in reversed(self.spans) if along_m >= s.start_m)
        return along(span.pose, along_m - span.start_m, span.bend)

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(along_m, left_m, up_m), each (N,), of (N, 3) points: the nearest piece of the centre line counts."""
        best = np.full(len(points), np.inf)
        distance_along, left = np.zeros(len(points)), np.zeros(len(points))
        for span in self.spans:
            s, aside = span.locate(points)
            beyond = np.maximum(np.maximum(-s, s - span.length_m), 0.0)
            distance = beyond + np.abs(aside)
            nearer = distance < best
            best = np.where(nearer, distance, best)
            distance_along, left = np.where(nearer, span.start_m + s, distance_along), np.where(nearer, aside, left)
        return distance_along, left, points[:, 2].copy()

    def flat(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) along_m and around_m of (N, 3) points of the wall."""
        distance_along, left, up = self.locate(points)
        return np.stack([distance_along, self.section.around(left, up)], axis=1)

    def points(self, along_m: np.ndarray, around_m: np.ndarray) -> np.ndarray:
        """(N, 3) points of the wall from (N,) each: the other way round."""
        left, up = self.section.wall(around_m)
        out = np.stack([np.zeros_like(left), left, up], axis=1)
        for span, behind in zip(self.spans, (*self.spans[1:], None), strict=True):
            mine = (along_m >= span.start_m) & (along_m < (np.inf if behind is None else behind.start_m))
            out[mine] = span.place(along_m[mine] - span.start_m, left[mine], up[mine])
        return out

    def trace(self, origin: np.ndarray, directions: np.ndarray, reach_m: float) -> np.ndarray:
        """(N,) distances from the (3,) origin along (N, 3) unit directions to the wall, NaN beyond reach_m.

        Sphere tracing (Hart 1996): nothing is nearer than the slack. Near the wall, where that creeps, by the secant."""
        t, alive = np.zeros(len(directions)), np.arange(len(directions))
        gap_before, step_before = np.full(len(directions), np.nan), np.zeros(len(directions))
        close = TOUCHING * self.section.size_m
        for k in range(TRACE_STEPS):
            _, left, up = self.locate(origin + t[alive, None] * directions[alive])
            gap = self.section.slack(left, up)
            going = (np.abs(gap) > close) & (t[alive] < reach_m)
            alive, gap = alive[going], gap[going]
            if not len(alive):
                break
            fallen = gap_before[alive] - gap
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.clip(np.where(fallen * step_before[alive] > 0, step_before[alive] / fallen, 1.0), 0.5, 20.0)
            step = gap * slope if k > SPHERES else np.maximum(gap, 0.0)
            gap_before[alive], step_before[alive] = gap, step
            t[alive] += step
        t[alive] = np.nan
        return np.where(t < reach_m, t, np.nan)


@dataclass(frozen=True, eq=False)
class Span:
    """A piece of a centre line: from start_m along it for length_m, with a curvature, beginning at the 4x4 pose."""

    start_m: float
    length_m: float
    bend: float
    pose: np.ndarray

    def locate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(s, left), each (N,): along the piece from its start, and aside of it, of (N, 3) points."""
        x, y = ((points[:, :2] - self.pose[:2, 3]) @ self.pose[:2, :2]).T
        if self.bend == 0.0:
            return x, y
        radius, turn = abs(1.0 / self.bend), np.sign(self.bend)
        across = radius - turn * y
        return radius * np.arctan2(x, across), turn * (radius - np.hypot(x, across))

    def place(self, s: np.ndarray, left: np.ndarray, up: np.ndarray) -> np.ndarray:
        """(N, 3) points from s along the piece, left and up of it."""
        if self.bend == 0.0:
            local = np.stack([s, left, up], axis=1)
        else:
            radius, angle = 1.0 / self.bend, s * self.bend
            local = np.stack([(radius - left) * np.sin(angle), radius - (radius - left) * np.cos(angle), up], axis=1)
        return transform(self.pose, local)


def along(pose: np.ndarray, length_m: float, bend: float) -> np.ndarray:
    """4x4 pose after going `length_m` with that curvature."""
    further: np.ndarray = pose @ se2(*arc(length_m, length_m * bend))
    return further
