"""Does the laser sit on the robot as was told? Its scans and the wheels must tell of one motion.

A laser that is mounted upside down sees the robot turn the other way round, one that is turned about its axis sees it drive
another way. So each stretch of the wheels' travel is put through every mount there may be, upside down or not, turned by
steps of COARSE_DEG, and the mount is believed under which most ends of the scan before are seen again in the scan after.
What was told stands until stretch after stretch contradicts it (z-test of the paired shares, over the stretches that tell
between the two). The setting is that of
calibrating odometry and sensor at once (Censi, Franchi, Marchionni and Oriolo, IEEE Transactions on Robotics 2013); here the
mount is looked for on a grid, because a mistake of 90 or 180 degrees is no matter of refining. Where the laser stands on the
robot is not asked: on so short a way it hardly shows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.geometry import inverse, planar, se2, wrap
from rhs.api.records import Scan
from rhs.estimation.views.motion_consistency import scan_share

from .planar_poses import between, composed
from .settings import SEES_AROUND_RAD

TURN_RAD, WAY_M = 0.3, 0.5  # a stretch of the wheels' travel is a turn or a way of so much
MOST_M = 1.5  # a robot that turns by less on such a way is taken to go straight
MOST_STRETCHES = 40  # of either kind, turns and ways
APART_DEG = 1.0  # beams
HEADINGS_RAD = np.radians([-6.0, -3.0, 0.0, 3.0, 6.0])  # by which the wheels' heading may be off after a stretch
COARSE_DEG, FINE_DEG = 30, 5
APART_RAD, APART_M = 0.15, 0.1  # a stretch tells between two mounts whose travels are as far apart
LEAST_TELLING = 10  # stretches
LEAST_GAIN, LEAST_Z = 0.15, 5.0  # share of the beams by which a mount must explain them better, and how surely
LEAST_YAW_DEG = 25  # wheels that drift by less look like a mount that is turned
LEAST_HEADING_DEG = 5.0  # of the way as it was solved, which knows how wheels drift


Seen = dict[int, Scan | None]  # by the number of the view
Stretch = tuple[int, int, np.ndarray]  # first scan, last scan, travel (3,)


@dataclass(frozen=True)
class MountFit:
    """How the laser sits, seen from how it was told to: upside_down (rolled by 180 degrees), then turned by yaw_deg about
    the body's z, 0 where that is less than LEAST_YAW_DEG."""

    upside_down: bool
    yaw_deg: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """A mount on trial: the travel (M, 3) of the laser that it makes of each stretch, and the share (M,) of the beams that
    go on then, NaN where too few tell."""

    upside_down: bool
    yaw_deg: float
    travel: np.ndarray
    shares: np.ndarray


def fit_mount(scans: Sequence[Scan | None], wheels: Sequence[np.ndarray | None]) -> MountFit | None:
    """How the laser of these scans sits beside wheels that told of travel (3,) since the scan before; None where they show
    too little."""
    stretches = _stretches(wheels)
    seen = {k: _thinned(scans[k]) for stretch in stretches for k in stretch[:2]}
    told = best = _trial(seen, stretches, False, 0.0)
    if np.isfinite(told.shares).sum() < LEAST_TELLING:
        return None
    for upside_down in (False, True):
        found = _turned(seen, stretches, upside_down)
        if _clearly(found, best) and (not upside_down or _clearly(found, _unturned(seen, stretches, found))):
            best = found
    yaw_deg = (best.yaw_deg + 180.0) % 360.0 - 180.0
    return MountFit(best.upside_down, yaw_deg if abs(yaw_deg) >= LEAST_YAW_DEG else 0.0)


def mount_figures(scans: Sequence[Scan | None], wheels: Sequence[np.ndarray | None]) -> dict[str, float]:
    """`fit_mount` of what a laser measured, as columns; nothing where there are no wheels, or it sees too little at once."""
    first = next((scan for scan in scans if scan is not None), None)
    if first is None or np.ptp(first.bearings_rad) < SEES_AROUND_RAD or all(wheel is None for wheel in wheels):
        return {}
    fit = fit_mount(scans, wheels)
    return {} if fit is None else {"mount_roll_off_deg": 180.0 * fit.upside_down, "mount_yaw_off_deg": fit.yaw_deg}


def heading_figures(poses: np.ndarray, wheels: Sequence[np.ndarray | None]) -> dict[str, float]:
    """`mount_heading_off_deg`: by how much a sensor (laser, lidar, camera) is turned about the vertical (left positive) seen
    from what was told, by the way (N, 4, 4) that it saw and that of the wheels; nothing where these say too little.

    The median over stretches without much of a turn of how the two chords lie, each to the mean of its headings at both
    ends: a drift of the wheels' heading, which bends their chord by half of what it turns them, does not count."""
    seen, told = [], []
    for first, last, travel in _stretches(wheels):
        here = planar(inverse(poses[first]) @ poses[last])
        if np.hypot(*travel[:2]) >= WAY_M and np.hypot(*here[:2]) >= 0.5 * WAY_M and abs(travel[2]) < TURN_RAD:
            seen.append(here)
            told.append(travel)
    if len(seen) < LEAST_TELLING:
        return {}
    headings = [np.arctan2(way[:, 1], way[:, 0]) - 0.5 * way[:, 2] for way in (np.array(seen), np.array(told))]
    off_deg = np.degrees(wrap(headings[1] - headings[0]))
    middle = float(np.median(off_deg))
    error = 1.48 * float(np.median(np.abs(off_deg - middle))) / np.sqrt(len(off_deg))
    return {"mount_heading_off_deg": middle if abs(middle) > max(LEAST_HEADING_DEG, LEAST_Z * error) else 0.0}


def heading_doubt(figures: Mapping[str, float]) -> str:
    """What is wrong where a sensor is turned by less than what fails a run, and what to type; empty where nothing is."""
    off = figures.get("mount_heading_off_deg", 0.0)
    if not off or figures.get("mount_yaw_off_deg") or figures.get("mount_roll_off_deg"):
        return ""
    return (f"by its way and the wheels' the sensor is turned by {off:.0f} degrees (left positive), which nobody told: the "
            f"way is right, headings are off by so much; type source.scan_mount=[0,0,0,0,0,{off:.0f}] (of a camera "
            "source.camera_mount), or turn the mount that was told")


def _turned(scans: Seen, stretches: list[Stretch], upside_down: bool) -> _Trial:
    """The mount turned so that most beams go on."""
    best = _trial(scans, stretches, upside_down, 0.0)
    for step, around in ((COARSE_DEG, 180), (FINE_DEG, COARSE_DEG)):
        middle = best.yaw_deg
        for off in range(-around + step, around + 1, step):
            found = _trial(scans, stretches, upside_down, middle + off)
            best = found if np.nansum(found.shares) > np.nansum(best.shares) else best
    return best


def _clearly(found: _Trial, before: _Trial) -> bool:
    """Whether more beams go on under one mount than under another beyond chance, where the two tell of different travel."""
    off = between(before.travel, found.travel)
    gain = found.shares - before.shares
    telling = np.isfinite(gain) & ((np.abs(off[:, 2]) > APART_RAD) | (np.hypot(off[:, 0], off[:, 1]) > APART_M))
    gain = gain[telling]
    if len(gain) < LEAST_TELLING:
        return False
    error = float(gain.std(ddof=1)) / np.sqrt(len(gain))
    return bool(gain.mean() > max(LEAST_GAIN, LEAST_Z * error))


def _stretches(wheels: Sequence[np.ndarray | None]) -> list[Stretch]:
    """As many ways as turns, each kind one after another."""
    kinds: tuple[list[Stretch], ...] = ([], [])
    for kind, turns in zip(kinds, (False, True), strict=True):
        first, travel = 0, np.zeros(3)
        for k, wheel in enumerate(wheels):
            if k == 0 or wheel is None or not np.isfinite(wheel).all():
                first, travel = k, np.zeros(3)
                continue
            travel = composed(travel, wheel)
            way_m = float(np.hypot(*travel[:2]))
            ends = abs(travel[2]) >= TURN_RAD if turns else way_m >= WAY_M
            if ends:
                kind.append((first, k, travel))
            if ends or way_m >= MOST_M:
                first, travel = k, np.zeros(3)
    return [kind[i] for kind in kinds
            for i in np.unique(np.linspace(0, len(kind) - 1, min(len(kind), MOST_STRETCHES)).astype(int))]


def _unturned(scans: Seen, stretches: list[Stretch], trial: _Trial) -> _Trial:
    """The same of a robot that turned nowhere: wheels whose heading drifts say that it did."""
    travel = trial.travel * [1.0, 1.0, 0.0]
    return replace(trial, travel=travel, shares=_shares(scans, stretches, travel))


def _trial(scans: Seen, stretches: list[Stretch], upside_down: bool,
           yaw_deg: float) -> _Trial:
    side, yaw = -1.0 if upside_down else 1.0, np.radians(yaw_deg)
    c, s = np.cos(yaw), np.sin(yaw)
    moved = [(c * x + s * y, side * (c * y - s * x), side * turn) for *_, (x, y, turn) in stretches]
    travel = np.array(moved).reshape(-1, 3)
    return _Trial(upside_down, yaw_deg, travel, _shares(scans, stretches, travel))


def _shares(scans: Seen, stretches: list[Stretch], travel: np.ndarray) -> np.ndarray:
    """(M,) share of the beams that go on after each travel (M, 3), with the best heading that wheels may have meant."""
    tried = [[scan_share(scans[first], scans[last], se2(x, y, turn + off), fine=True) for off in HEADINGS_RAD]
             for (first, last, _), (x, y, turn) in zip(stretches, travel, strict=True)]
    best: np.ndarray = np.fmax.reduce(np.array(tried).reshape(-1, len(HEADINGS_RAD)), axis=1)
    return best


def _thinned(scan: Scan | None) -> Scan | None:
    """The scan with beams no nearer than APART_DEG: finer ones ask for more than wheels can tell."""
    if scan is None or len(scan.bearings_rad) < 2:
        return scan
    every = max(round(np.radians(APART_DEG) / float(np.median(np.diff(scan.bearings_rad)))), 1)
    return replace(scan, bearings_rad=scan.bearings_rad[::every], ranges_m=scan.ranges_m[::every])
