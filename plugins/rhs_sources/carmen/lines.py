"""Lines of a CARMEN log: scans with or without their pose, odometry and true poses, in metres and radians.

Format (CARMEN's logger, http://carmen.sourceforge.net/logger_playback.html; each line ends in `stamp host logged`):
`FLASER n ranges x y theta odom_x odom_y odom_theta`; `ROBOTLASER1 type start fov step max accuracy mode n ranges [m
remissions] x y theta robot_x robot_y robot_theta tv rv front side [turn]`; `RAWLASER1` begins like it and has no pose;
`ODOM x y theta tv rv accel`; `TRUEPOS x y theta odom_x odom_y odom_theta`, of a simulator.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rhs.api.errors import ConfigError

from ..replay_stamps import number_of

MAX_BEAMS = 10_000
HEAD = 8  # words of ROBOTLASER1 and RAWLASER1 before the number of ranges
MOST_RAD = 2.0 * np.pi + 0.05  # between the first beam and the last: a turn, as it is rounded
AGREE = 0.02  # of a field of view, that rounding is
AFTER_RANGES = (13, 14)  # words behind the ranges of a line without remissions: two poses, four or five more, the tail
TAIL = 3  # stamp, host, when it was logged
Pose = tuple[float, float, float]


class Reading(NamedTuple):
    """bearings_rad and ranges_m (N,); the poses of the laser and of the robot's odometry, None: the line has none."""

    bearings_rad: np.ndarray
    ranges_m: np.ndarray
    max_m: float
    laser: Pose | None
    odometry: Pose | None
    stamp_s: float


def flaser(words: list[str], where: str, fov_rad: float, max_m: float) -> Reading:
    """A line of the old kind, that says neither how its beams lie nor how far they reach."""
    count = _count(words, 1, where)
    if not 1 <= count <= MAX_BEAMS or len(words) < 2 + count + 7:
        raise ConfigError(f"{where}: found {len(words)} words for {count} beams;"
                          " expected FLASER n ranges x y theta odom_x odom_y odom_theta stamp")
    values = [number_of(word, where) for word in words[2 : 2 + count + 7]]
    x, y, turn, odom_x, odom_y, odom_turn, stamp = values[count:]
    return Reading(centred(count, fov_rad), np.array(values[:count]), max_m, (x, y, turn),
                   _finite((odom_x, odom_y, odom_turn), where), stamp)


def robotlaser(words: list[str], where: str, max_m: float) -> Reading:
    """A line of the newer kind; RAWLASER1 has no pose. max_m: the most that is believed, where the line says more."""
    posed = words[0].startswith("ROBOT")
    count = _count(words, HEAD, where)
    after = HEAD + 1 + count
    if not 1 <= count <= MAX_BEAMS or len(words) < after + TAIL + (6 if posed else 0):
        poses = " x y theta robot_x robot_y robot_theta" if posed else ""
        raise ConfigError(f"{where}: found {len(words)} words for {count} beams; expected {words[0]} type start fov step "
                          f"max accuracy mode n ranges{poses} stamp host logged")
    if words[after].isdigit() and not (posed and _is_pose(words, after)):  # remissions: their number and as many
        after += 1 + int(words[after])
    start, fov, step, most = (number_of(word, where) for word in words[2:6])
    ranges = np.array([number_of(word, where) for word in words[HEAD + 1 : HEAD + 1 + count]])
    step = fov / max(count - 1, 1) if step <= 0.0 or _is_fov(start, fov, step, count) else step
    if not np.isfinite([start, step]).all() or not 0.0 <= step * (count - 1) <= MOST_RAD:
        raise ConfigError(f"{where}: {count} beams from {start:g} by {step:g} rad; expected at most a turn")
    laser = odometry = None
    if posed:
        if len(words) < after + 6 + TAIL:
            raise ConfigError(f"{where}: found {len(words)} words; expected the poses of laser and robot behind {count} "
                              "ranges")
        x, y, turn, odom_x, odom_y, odom_turn = (number_of(word, where) for word in words[after : after + 6])
        laser, odometry = (x, y, turn), _finite((odom_x, odom_y, odom_turn), where)
    return Reading(from_start(count, start, step), ranges, min(max_m, most) if most > 0.0 else max_m, laser, odometry,
                   number_of(words[-TAIL], where))


def _is_pose(words: list[str], after: int) -> bool:
    """Whether what follows the ranges is x of a pose, written without a point, and no number of remissions: with them there
    are too few words behind."""
    behind = len(words) - after
    return behind in AFTER_RANGES and behind - 1 - int(words[after]) < AFTER_RANGES[-1]


def _is_fov(start: float, fov: float, step: float, count: int) -> bool:
    """Whether step and field of view tell of different scans, and the beams begin where the field of view, straight ahead,
    has them begin."""
    contradicts = abs(step * (count - 1) - fov) > AGREE * fov and abs(step * count - fov) > AGREE * fov
    return contradicts and fov > 0.0 and abs(start + 0.5 * fov) < AGREE * fov


def stamped_pose(words: list[str], where: str) -> tuple[float, Pose]:
    """(stamp, x y theta) of an ODOM or TRUEPOS line."""
    if len(words) < 4 + TAIL:
        raise ConfigError(f"{where}: found {len(words)} words; expected {words[0]} x y theta ... stamp host logged")
    x, y, turn = (number_of(word, where) for word in words[1:4])
    return number_of(words[-TAIL], where), _finite((x, y, turn), where)


@lru_cache(maxsize=64)
def centred(beams: int, fov_rad: float) -> np.ndarray:
    """(N,) radians from right to left, centred ahead. 180 beams of 180 degrees are one degree apart (half a degree off
    either end), 181 reach both ends."""
    step = fov_rad / beams if beams % 2 == 0 else fov_rad / max(beams - 1, 1)
    return _fixed((np.arange(beams) - (beams - 1) / 2.0) * step)


@lru_cache(maxsize=64)
def from_start(beams: int, start_rad: float, step_rad: float) -> np.ndarray:
    """(N,) radians, step_rad apart."""
    return _fixed(start_rad + step_rad * np.arange(beams))


def _fixed(bearings: np.ndarray) -> np.ndarray:
    bearings.setflags(write=False)
    return bearings


def _count(words: list[str], at: int, where: str) -> int:
    count = number_of(words[at], where) if len(words) > at else 0.0
    return int(count) if np.isfinite(count) else 0


def _finite(pose: Pose, where: str) -> Pose:
    if not np.all(np.isfinite(pose)):
        raise ConfigError(f"{where}: the odometry holds NaN or infinity; expected finite x y theta")
    return pose
