"""Straight walls in one scan: where they run, and how well the scan knows it.

Seen from the origin of the beams, a line with normal n at distance d meets the beam of direction u at the range d / (n.u).
So the inverse range is linear in the direction, 1/r = (n / d).u, and its noise is nearly the same at all ranges for a depth
camera that triangulates (a Kinect: sigma_z grows with z^2, Nguyen, Izadi and Lovell 2012): a straight wall is an ordinary
least-squares fit of two numbers, without the bias of fitting noisy points. Stretches of beams are split where they leave
their chord most (iterative end-point fit: Nguyen, Gaechter, Martinelli, Tomatis, Siegwart, A comparison of line extraction
algorithms using 2D range data, Autonomous Robots 2007), in this inverse range instead of in metres.

A bent wall must not pass for a straight one: parts that touch and hardly turn against each other are a bend cut to pieces,
and are left out; and each line carries the curvature that its beams show, so that many scans together can tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import se2, wrap
from rhs.api.records import Scan

from .settings import LineSettings


@dataclass(frozen=True, eq=False)
class WallLine:
    """body_from_line: 4x4, x along the wall, y off the wall towards the robot. sigma_m: across the wall, at the origin of
    that frame; sigma_rad: of its direction; the two errors are independent there. ends_m (2,): of the stretch, along x.
    bend_per_m: curvature that the beams show, 1/m, positive when the wall bends away from the robot; sigma_bend: of it."""

    body_from_line: np.ndarray
    sigma_m: float
    sigma_rad: float
    ends_m: np.ndarray
    bend_per_m: float
    sigma_bend: float


def find_wall_lines(scan: Scan, settings: LineSettings | None = None) -> list[WallLine]:
    """The straight walls of a scan, in the order of its beams."""
    settings = settings or LineSettings()
    ranges = np.asarray(scan.ranges_m, float)
    with np.errstate(invalid="ignore"):
        known = np.nonzero((ranges > 0.1) & (ranges < settings.range_max_m))[0]
    if len(known) < settings.least_beams:
        return []
    fit = _Stretches(1.0 / ranges[known], np.asarray(scan.bearings_rad, float)[known], settings)
    ends = np.nonzero((np.diff(known) > settings.gap_beams) | (np.abs(np.diff(fit.near)) > settings.jump_per_m))[0] + 1
    bounds = [0, *ends.tolist(), len(known)]
    pieces = [piece for low, high in zip(bounds, bounds[1:], strict=False) for piece in fit.split(low, high)]
    parts = fit.alone(fit.merged(pieces))
    trim, origin_m = settings.trim_beams, np.asarray(scan.origin_xy_m)
    lines = [fit.line(low + trim, high - trim, origin_m) for low, high in parts]
    return [line for line in lines if line is not None]


class _Stretches:
    """Beams of known range, and least squares over any stretch of them from running sums."""

    def __init__(self, near: np.ndarray, bearings_rad: np.ndarray, settings: LineSettings) -> None:
        """near (N,): inverse ranges, 1/m."""
        self.near, self.settings = near, settings
        self.c, self.s = np.cos(bearings_rad), np.sin(bearings_rad)
        terms = np.stack([self.c**2, self.c * self.s, self.s**2, near * self.c, near * self.s, near**2])
        self._sums = np.concatenate([np.zeros((6, 1)), np.cumsum(terms, axis=1)], axis=1).T.tolist()

    def fit(self, low: int, high: int) -> tuple[tuple[float, float], float, np.ndarray] | None:
        """n / d (2,), rms of the inverse ranges and the inverse normal matrix (2, 2) of the beams [low, high)."""
        cc, cs, ss, qc, qs, qq = (b - a for a, b in zip(self._sums[low], self._sums[high], strict=True))
        det = cc * ss - cs * cs
        if det < 1e-9:
            return None
        a, b = (ss * qc - cs * qs) / det, (cc * qs - cs * qc) / det
        rms = (max(qq - a * qc - b * qs, 0.0) / (high - low)) ** 0.5
        return (a, b), rms, np.array([[ss, -cs], [-cs, cc]]) / det

    def straight(self, low: int, high: int) -> bool:
        """Whether one line explains the beams: noise as expected, and no quarter of them that lies off it."""
        found = self.fit(low, high)
        if found is None or found[1] > 2.0 * self.settings.sigma_per_m:
            return False
        (a, b), quarter = found[0], (high - low) // 4
        off = self.near[low:high] - a * self.c[low:high] - b * self.s[low:high]
        means = np.abs(off[: 4 * quarter].reshape(4, quarter).mean(axis=1))
        return bool(means.max() < 4.0 * self.settings.sigma_per_m / quarter**0.5)

    def split(self, low: int, high: int) -> list[tuple[int, int]]:
        """The straight parts of [low, high): itself, or those of its parts on both sides of where it leaves its chord."""
        if high - low < self.settings.least_beams:
            return []
        if self.straight(low, high):
            return [(low, high)]
        at = self._furthest(low, high)
        return self.split(low, at) + self.split(at, high)

    def _furthest(self, low: int, high: int) -> int:
        """The beam furthest from the line through both ends of [low, high), in inverse range, smoothed over five beams."""
        first, last = low + 2, high - 3
        wide = self.c[first] * self.s[last] - self.s[first] * self.c[last]
        if abs(wide) < 1e-6:
            return (low + high) // 2
        here, there = self.near[low : low + 5].mean(), self.near[high - 5 : high].mean()
        chord = ((self.s[last] * here - self.s[first] * there) / wide, (self.c[first] * there - self.c[last] * here) / wide)
        off = self.near[low:high] - chord[0] * self.c[low:high] - chord[1] * self.s[low:high]
        at = low + 4 + int(np.abs(np.convolve(off, np.full(5, 0.2), "same")[4:-4]).argmax())
        return at if low + 5 <= at < high - 5 else (low + high) // 2

    def merged(self, pieces: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """Neighbouring pieces that one line explains, as one."""
        out: list[tuple[int, int]] = []
        for low, high in pieces:
            if out and low - out[-1][1] <= self.settings.gap_beams and self.straight(out[-1][0], high):
                out[-1] = out[-1][0], high
            else:
                out.append((low, high))
        return out

    def alone(self, pieces: list[tuple[int, int]]) -> list[tuple[int, int]]:
        """The pieces that do not go on round a bend in their neighbour."""
        found = [self.fit(*piece) for piece in pieces]
        ways = [None if fit is None else np.arctan2(fit[0][1], fit[0][0]) for fit in found]
        bent = set()
        for k in range(len(pieces) - 1):
            first, second = ways[k], ways[k + 1]
            if first is None or second is None or pieces[k + 1][0] - pieces[k][1] > self.settings.gap_beams:
                continue
            if abs(wrap(second - first)) < np.radians(self.settings.corner_deg):
                bent |= {k, k + 1}
        return [piece for k, piece in enumerate(pieces) if k not in bent]

    def _bend(self, low: int, high: int, slope: np.ndarray, inverse: np.ndarray) -> tuple[float, float]:
        """Curvature of the beams [low, high) against their line n / d, 1/m, and its sigma: a third term of the fit.
        inverse (2, 2): of its normal matrix."""
        c, s = self.c[low:high], self.s[low:high]
        steep2 = float(slope @ slope)
        facing = slope[0] * c + slope[1] * s  # n.u / d
        along = (slope[0] * s - slope[1] * c) / (facing * steep2**0.5)  # metres from the foot of the perpendicular
        term = -0.5 * facing * steep2**0.5 * (along - along.mean()) ** 2
        base = np.stack([c, s], axis=1)
        both = np.stack([term, self.near[low:high]], axis=1)
        rest, off = (both - base @ (inverse @ (base.T @ both))).T
        size2 = float(rest @ rest)
        sigma = (self.settings.shared / max(size2, 1e-18)) ** 0.5 * self.settings.sigma_per_m
        return float(rest @ off) / max(size2, 1e-18), sigma

    def line(self, low: int, high: int, origin_m: np.ndarray) -> WallLine | None:
        """The wall that the beams [low, high) see, or None when they are too few or see too little of it."""
        found = self.fit(low, high) if high - low >= self.settings.least_beams else None
        if found is None:
            return None
        slope, rms, spread = np.array(found[0]), found[1], found[2]
        steep = float(np.hypot(*slope))
        normal = slope / steep
        along = np.array([-normal[1], normal[0]])  # with the wall on the right hand, so that y points to the robot
        slant = np.array([[self.c[k], self.s[k]] for k in (low, high - 1)])
        if (slant @ normal).min() < 0.02:
            return None
        ends = (slant @ along) / (slant @ normal) / steep
        if abs(ends[1] - ends[0]) < self.settings.least_m:
            return None
        bend, sigma_bend = self._bend(low, high, slope, spread)
        if abs(bend) > self.settings.bend_sigma * sigma_bend:
            return None
        spread = spread * max(rms, self.settings.sigma_per_m) ** 2 * self.settings.shared
        at, sigma_m, sigma_rad = _best_known(spread, normal, along, steep)
        middle = normal / steep + at * along + origin_m
        frame = se2(float(middle[0]), float(middle[1]), float(np.arctan2(along[1], along[0])))
        return WallLine(frame, sigma_m, sigma_rad, np.sort(ends) - at, bend, sigma_bend)


def _best_known(spread: np.ndarray, normal: np.ndarray, along: np.ndarray, steep: float) -> tuple[float, float, float]:
    """Where along the wall (m from the foot of the perpendicular) its place is known best, and the sigmas across it there
    and of its direction; spread (2, 2): covariance of n / d."""
    turn = along / steep  # derivative of the direction by n / d
    there, by_way = -normal / steep**2, -along / steep  # and of the place across the wall, at the foot and per metre
    at = -(there @ spread @ turn) / (by_way @ spread @ turn)
    across = there + at * by_way
    return float(at), float(np.sqrt(across @ spread @ across)), float(np.sqrt(turn @ spread @ turn))
