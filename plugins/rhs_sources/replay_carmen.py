"""CARMEN logs: FLASER scans with the odometry of the moment they were taken, in metres and radians.

Format: the header of every log. Lines of other kinds (ODOM, PARAM, ...) are not needed: FLASER carries its odometry.
The scans are taken in the order of the file; stamps that step back are repaired and counted, and the log's own travel with
the views (`log_stamp_s`), because relations name scans by them. The body is the scanner: where the laser's pose is the
odometry's moved by a constant, its pose is the way taken; where somebody has corrected it, the odometry is.
True poses of the scanner may be typed (`source.truth`), by the log's stamps as they were repaired.
The log of a robot with `.relations` beside it has true relations between stamps (Kuemmerle et al., 2009), not poses.
"""

from __future__ import annotations

import bz2
import gzip
from collections import Counter
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, planar, se2
from rhs.api.records import Capture, Scan, WorldFacts

from .replay_mounts import mount_of, mounted
from .replay_stamps import in_file_order, number_of, typed_truth
from .replay_tum import Recording

SUFFIXES = (".clf", ".log", ".clf.gz", ".clf.bz2", ".log.gz", ".log.bz2")
CONSTANT_M, CONSTANT_RAD = 0.01, 0.01  # a mount stays where it is, up to rounding
NO_CAMERA = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)  # a robot that sees by laser alone
MAX_LINE = 1_000_000  # characters; a damaged file may have no line ends
MAX_BEAMS = 10_000


def is_carmen(path: Path) -> bool:
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


def open_carmen(path: Path, settings) -> Recording:
    """The scans of a CARMEN log with wheel travel between them; the first pose of the odometry is the map's origin."""
    own, poses, scans = _read(path, settings)
    if not own:
        raise ConfigError(f"{path}: no FLASER line; expected a CARMEN log with laser scans")
    stamps, repaired = in_file_order(own, settings.max_jump_s)
    kept = range(len(own))[settings.start :: settings.stride][: settings.count or None]
    if not kept:
        raise ConfigError(f"{path}: source.start={settings.start} but the log has {len(own)} scans")

    truth = typed_truth(settings)
    mount = mount_of(settings.scan_mount, "scan_mount")
    wheels = len(own) == 1 or any((pose != poses[0]).any() for pose in poses)  # readings that never change are none

    def views():
        for index, i in enumerate(kept):
            travel = None if index == 0 or not wheels else planar(inverse(poses[kept[index - 1]]) @ poses[i])
            extras = {"log_stamp_s": np.array([own[i]])} if repaired else {}
            scan = mounted(scans[i], mount, path.name)
            capture = Capture(index, float(stamps[i]), travel=travel, scan=scan, sensed=True, extras=extras)
            yield capture, truth.at(capture.stamp_s) if truth is not None else None

    facts = _facts(path, [poses[i] for i in kept], scans[0].max_range_m)
    provides = frozenset({"scan", *(["wheel"] if wheels else []), *(["log_stamp_s"] if repaired else [])})
    return Recording(NO_CAMERA, views(), len(kept), Counter(), facts, provides, repaired=repaired)


def _facts(path: Path, poses: list[np.ndarray], max_range_m: float) -> WorldFacts:
    """A world as large as the odometry says it went, a fifth more for its drift, and what the laser sees beyond."""
    away = np.array([(inverse(poses[0]) @ pose)[:2, 3] for pose in poses])
    low, high = away.min(axis=0), away.max(axis=0)
    margin = 0.2 * float((high - low).max()) + min(max_range_m, 15.0)
    west, south, east, north = (float(v) for v in (*(low - margin), *(high + margin)))
    return WorldFacts(path.name.split(".")[0], (0.0, 0.0, 0.0), (), (west, south, east, north), 0.25)


def _read(path: Path, settings) -> tuple[list[float], list[np.ndarray], list[Scan]]:
    stamps, odometry, lasers, scans = [], [], [], []
    bearings: dict[int, np.ndarray] = {}
    with _opened(path) as file:
        number = 0
        while line := file.readline(MAX_LINE):
            number += 1
            if not line.startswith(b"FLASER"):
                continue
            where = f"{path.name}:{number}"
            ranges, laser, pose, stamp = _flaser(line.decode("ascii", "replace").split(), where)
            beams = len(ranges)
            if beams not in bearings:
                bearings[beams] = _bearings(beams, settings.laser_fov_deg)
            stamps.append(stamp)
            odometry.append(se2(*pose))
            lasers.append(se2(*(pose if settings.scan_mount else laser)))  # a mount that was typed is on the wheels' body
            scans.append(_scan(bearings[beams], ranges, settings.max_laser_m))
    return stamps, _way(lasers, odometry), scans


def _way(lasers: list[np.ndarray], odometry: list[np.ndarray]) -> list[np.ndarray]:
    """The laser's poses where they are the odometry's moved by a constant, else the odometry's."""
    if not lasers or not np.isfinite(lasers).all():
        return odometry
    mounts = inverse(np.array(odometry)) @ np.array(lasers)
    off = inverse(mounts[0]) @ mounts
    turned = np.abs(np.arctan2(off[:, 1, 0], off[:, 0, 0]))
    constant = np.abs(off[:, :2, 3]).max() < CONSTANT_M and turned.max() < CONSTANT_RAD
    return lasers if constant else odometry


def _flaser(words: list[str], where: str) -> tuple[np.ndarray, list[float], list[float], float]:
    """Ranges, poses (x, y, theta) of laser and odometry,
    and stamp of `FLASER n r1 .. rn x y th ox oy oth stamp host logged`."""
    count = int(number_of(words[1], where)) if len(words) > 1 else 0
    if not 1 <= count <= MAX_BEAMS or len(words) < 2 + count + 7:
        raise ConfigError(f"{where}: found {len(words)} words for {count} beams;"
                          " expected FLASER n ranges x y theta odom_x odom_y odom_theta stamp")
    values = [number_of(word, where) for word in words[2 : 2 + count + 7]]
    pose = values[count + 3 : count + 6]
    if not np.all(np.isfinite(pose)):
        raise ConfigError(f"{where}: the odometry holds NaN or infinity; expected finite x y theta")
    return np.array(values[:count]), values[count : count + 3], pose, values[count + 6]


def _bearings(beams: int, fov_deg: float) -> np.ndarray:
    """(N,) radians from right to left, centred ahead. 180 beams of 180 degrees are one degree apart (half a degree off
    either end), 181 reach both ends."""
    fov = np.radians(fov_deg)
    step = fov / beams if beams % 2 == 0 else fov / (beams - 1)
    out = (np.arange(beams) - (beams - 1) / 2.0) * step
    out.setflags(write=False)
    return out


def _scan(bearings: np.ndarray, ranges: np.ndarray, max_laser_m: float) -> Scan:
    """Ranges at or beyond the maximum are free space without an end (inf); not positive ones are unknown."""
    out = np.where(ranges >= max_laser_m, np.inf, np.where(ranges > 0.0, ranges, np.nan))
    out.setflags(write=False)
    return Scan(bearings, out, max_laser_m)


def _opened(path: Path):
    if path.suffix == ".bz2":
        return bz2.open(path, "rb")
    return gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")
