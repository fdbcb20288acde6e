"""A laser scan whose beams were taken one after another while the robot drove, put right by the wheels.

A scanner that goes round ten times a second on a robot that turns at 1 rad/s sees its first and its last beam 6 degrees
apart. sensor_msgs/LaserScan has a field for it (`time_increment`), but drivers leave it at zero, write another unit or turn
the beams round without turning their times. So the scans are asked: of a scan taken while the robot turned, and one taken
while it turned otherwise, both are put right as if the beams went to the left, or to the right, in the time of a turn; that
is believed under which they fit each other clearly better than as they are (z-test of paired shares).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, planar, se2
from rhs.api.records import Capture, Scan
from rhs.estimation.scans.planar_poses import between
from rhs.estimation.scans.settings import PointSettings

from ..replay_mounts import UNTURNED, mounted
from . import messages as ros
from .wheels import first_with_wheels

log = logging.getLogger("rhs.replay")
LEAST_RADPS = 0.3  # by which two scans of a pair turn differently
APART_S, APART_M = 2.0, 0.5  # at most between them
LEAST_PAIRS, MOST_PAIRS = 8, 40
NEAR_M = (0.3, 0.05)  # partners are looked for at first, and counted at last
LEAST_GAIN, LEAST_Z = 0.02, 3.0  # share of the ends by which a way of the beams must explain pairs better, and how surely
TELLS = (0.25, 1.25)  # time_increment is believed where it makes such a share of the time between two scans
MOST_S = 1.0  # of a scan
LOOKED_AT, LEAST_BEAMS = 1500, 20  # scans; of each
Readings = tuple[np.ndarray, np.ndarray]  # stamps (N,), x y yaw (N, 3) of the wheels; yaw unwrapped


@dataclass(frozen=True)
class Turning:
    """span_s: from the beam with the least bearing to that with the greatest, below zero where the beams go the other way;
    0: they are of one instant. mount: 4x4 body_from_scanner; None: at the body."""

    span_s: float
    mount: np.ndarray | None
    topic: str = "the laser"

    def seen(self, capture: Capture, wheels: Sequence[tuple[float, np.ndarray]]) -> Capture:
        """The view with its scan as of its stamp, in the body's frame. wheels: (stamp, 4x4 pose) about it."""
        if capture.scan is None:
            return capture
        scan = self.straight(capture.scan, capture.stamp_s, readings(wheels)) if self.span_s else capture.scan
        return replace(capture, scan=mounted(scan, self.mount, self.topic))

    @property
    def body_from_scanner(self) -> np.ndarray:
        return UNTURNED if self.mount is None else self.mount

    def straight(self, scan: Scan, stamp_s: float, wheels: Readings) -> Scan:
        """The scan, in the scanner's frame, as of its stamp; as it is where the wheels do not say."""
        stamps, poses = wheels
        if not self.span_s or not len(stamps) or not stamps[0] <= stamp_s <= stamps[-1] - abs(self.span_s) + 1e-3:
            return scan
        share = np.linspace(0.0, 1.0, len(scan.ranges_m))
        after_s = abs(self.span_s) * (share if self.span_s > 0.0 else 1.0 - share)
        now = [np.interp(stamp_s + np.append(after_s, 0.0), stamps, column) for column in poses.T]
        steps = between(np.column_stack(now)[-1:], np.column_stack(now)[:-1])
        turn, place = self.body_from_scanner[:3, :3], self.body_from_scanner[:3, 3]
        ways = np.column_stack([np.cos(scan.bearings_rad), np.sin(scan.bearings_rad), np.zeros(len(share))])
        met = np.isfinite(scan.ranges_m)
        ends = np.where(met, scan.ranges_m, 1.0)[:, None] * ways @ turn.T + np.where(met[:, None], place, 0.0)
        c, s = np.cos(steps[:, 2]), np.sin(steps[:, 2])
        ends[:, :2] = np.column_stack([c * ends[:, 0] - s * ends[:, 1], s * ends[:, 0] + c * ends[:, 1]])
        ends[met, :2] += steps[met, :2]
        x, y, _ = turn.T @ (ends - np.where(met[:, None], place, 0.0)).T  # back in the scanner's frame
        return _in_order(scan, np.arctan2(y, x), np.where(met, np.hypot(x, y), scan.ranges_m))


def turning_in(reader, topics, mount: np.ndarray | None, most_m: float) -> Turning:
    """How the beams of a bag's laser go round, by its first scans that come beside wheels; said where they do."""
    found, wheels = first_with_wheels(reader, topics.scan, topics, LOOKED_AT)
    scans = []
    for stamp, message in found:
        with suppress(ConfigError):  # said where the views are read
            if len(message.ranges) > LEAST_BEAMS:
                scans.append((stamp, float(message.time_increment), ros.scan_of(message, topics.scan, most_m)))
    turning = replace(turning_of(scans, readings(wheels), mount), topic=topics.scan)
    if turning.span_s:
        log.warning("%s: a scan takes %.0f ms, in which the robot turns: scans are put right by the wheels "
                    "(source.deskew=false leaves them as they are)", topics.scan, 1e3 * abs(turning.span_s))
    return turning


def _in_order(scan: Scan, bearings: np.ndarray, ranges: np.ndarray) -> Scan:
    """Beams (N,) in the scan's own evenly spaced order: each in the nearest place, with its own bearing; of two in one the
    nearer; NaN where there is none."""
    grid = scan.bearings_rad
    step = float(grid[-1] - grid[0]) / (len(grid) - 1)
    off = (bearings - grid[0] + 0.5 * step) % (2.0 * np.pi) - 0.5 * step
    place = np.rint(off / step).astype(int)
    inside = np.flatnonzero(place < len(grid))
    inside = inside[np.argsort(-np.abs(off - place * step)[inside], kind="stable")]
    out_bearings, out_ranges = np.array(grid, float), np.full(len(grid), np.nan)
    out_bearings[place[inside]], out_ranges[place[inside]] = grid[0] + off[inside], ranges[inside]
    return replace(scan, bearings_rad=out_bearings, ranges_m=out_ranges)


def readings(wheels: Sequence[tuple[float, np.ndarray]]) -> Readings:
    """Of (stamp, 4x4 pose), ascending."""
    poses = np.array([planar(pose) for _, pose in wheels]).reshape(-1, 3)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return np.array([stamp for stamp, _ in wheels]), poses


def turning_of(scans: Sequence[tuple[float, float, Scan]], wheels: Readings, mount: np.ndarray | None) -> Turning:
    """How the beams of a scanner go round. scans: (stamp, time_increment as its driver wrote it, scan in its own frame)."""
    still, pairs = Turning(0.0, mount), _pairs(scans, wheels)
    if len(pairs) < LEAST_PAIRS:
        return still
    span_s = _span_s(scans)
    found = [_shares(scans, wheels, pairs, Turning(span, mount)) for span in (0.0, span_s, -span_s)]
    gains = np.array(found[1:]) - found[0]
    best = int(np.argmax(gains.mean(axis=1)))
    gain, error = float(gains[best].mean()), float(gains[best].std(ddof=1)) / np.sqrt(len(pairs))
    if gain < LEAST_GAIN or gain < LEAST_Z * error:
        return still
    return Turning((span_s, -span_s)[best], mount)


def _span_s(scans: Sequence[tuple[float, float, Scan]]) -> float:
    """Seconds that a scan takes: as its driver says where that can be, else its part of the time between two scans."""
    covered = float(np.ptp(scans[0][2].bearings_rad)) / (2.0 * np.pi)
    usual = covered * float(np.median(np.diff([stamp for stamp, *_ in scans])))
    said = scans[0][1] * (len(scans[0][2].ranges_m) - 1)
    return min(said if TELLS[0] * usual <= said <= TELLS[1] * usual else usual, MOST_S)


def _pairs(scans: Sequence[tuple[float, float, Scan]], wheels: Readings) -> list[tuple[int, int]]:
    """Of scans that were taken while the robot turned, each with the one near it that it turned most differently at."""
    stamps, poses = wheels
    at = np.array([stamp for stamp, *_ in scans])
    if len(stamps) < 2 or len(at) < 2:
        return []
    known = (at >= stamps[0]) & (at + 0.1 <= stamps[-1])
    x, y, yaw = (np.interp(at, stamps, column) for column in poses.T)
    rate = (np.interp(at + 0.1, stamps, poses[:, 2]) - yaw) / 0.1
    pairs: list[tuple[int, int]] = []
    for k in np.flatnonzero(known & (np.abs(rate) > LEAST_RADPS)):
        near = known & (np.abs(at - at[k]) < APART_S) & (np.hypot(x - x[k], y - y[k]) < APART_M)
        other = int(np.argmax(np.where(near, np.abs(rate - rate[k]), -1.0)))
        if abs(rate[other] - rate[k]) > LEAST_RADPS:
            pairs.append((int(k), other))
    return pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))]


def _shares(scans, wheels: Readings, pairs: list[tuple[int, int]], turning: Turning) -> np.ndarray:
    """(P,) share of the ends of the first scan of each pair that lie on those of the second, as near as they can be laid."""
    from rhs.estimation.scans.point_map import PointMap, cloud_of  # loads numba

    settings, out, mount = PointSettings(), [], turning.body_from_scanner
    for pair in pairs:
        stamps = [scans[k][0] for k in pair]
        seen, other = (cloud_of(turning.straight(scans[k][2], scans[k][0], wheels), settings) for k in pair)
        poses = np.column_stack([np.interp(stamps, wheels[0], column) for column in wheels[1].T])
        step = planar(inverse(mount) @ se2(*between(poses[1], poses[0])) @ mount)  # of the scanner
        out.append(PointMap(other.points, other.normals).fit(seen, step, np.eye(3), settings, reach=NEAR_M).share)
    return np.array(out)
