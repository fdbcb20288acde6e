"""CARMEN logs: scans with the odometry of the moment they were taken.

FLASER and ROBOTLASER1 carry their odometry; RAWLASER1 is read where a log has neither, with ODOM between the two lines about
it. The scans are taken in the order of the file; stamps that step back are repaired and counted, and the log's own travel
with the views (`log_stamp_s`), because relations name scans by them. The body is the scanner: where the laser's pose is the
odometry's moved by a constant, its pose is the way taken; where somebody has corrected it, the odometry is.
True poses of the scanner may be typed (`source.truth`), by the log's stamps as they were repaired; `source.truth=corrected`
are those that somebody corrected in the log. A simulator's TRUEPOS are the truth where nothing is typed.
The log of a robot with `.relations` beside it has true relations between stamps (Kuemmerle et al., 2009), not poses.
"""

from __future__ import annotations

import bz2
import gzip
import logging
import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, planar, se2
from rhs.api.records import Capture, Scan, WorldFacts
from rhs.api.settings import nearest

from ..replay_mounts import mount_of, mounted
from ..replay_stamps import Truth, ascending, in_file_order, in_order, typed_truth
from ..replay_tum import Recording
from ..unread import GRAPH
from .lines import Pose, Reading, flaser, robotlaser, stamped_pose

logger = logging.getLogger("rhs.replay")
HALF_TURN_DEG, USUAL_BEAMS = 180.0, (90, 180, 360, 720)  # of SICK's scanners, or one beam more
QUARTERS, NARROW_DEG = (400, 401), 100.0  # a SICK LMS 200 sees no more in steps of a quarter of a degree
SUFFIXES = (".clf", ".log", ".clf.gz", ".clf.bz2", ".log.gz", ".log.bz2")
TEXTS = (".txt", ".script", ".carmen", ".dat", "")
CONSTANT_M, CONSTANT_RAD = 0.01, 0.01  # a mount stays where it is, up to rounding
NO_CAMERA = Camera(1, 1, 1.0, 1.0, 0.0, 0.0)  # a robot that sees by laser alone
HEAD_BYTES = 200
LOOKED_AT = 20_000  # bytes of a log without scans
BEESOFT = ("a log of BeeSoft, in cm and degrees: write a line each, FLASER N ranges x y yaw x y yaw stamp host stamp, in "
           "metres and radians")
OTHER_LASER = re.compile(r"(ROBOT|RAW)LASER[2-5]|RLASER")  # rear ones, or a robot's second
STEP_SAID = b"PARAM laser_front_laser_resolution "  # degrees
AHEAD_SAID = b"PARAM robot_frontlaser_offset "  # metres
MOST_BROKEN = 0.05  # lines that are not whole, of each that is
MAX_LINE = 1_000_000  # characters; a damaged file may have no line ends
FLASER, ROBOT, RAW, ODOM, TRUE = b"FLASER ", b"ROBOTLASER1 ", b"RAWLASER1 ", b"ODOM ", b"TRUEPOS "
SCANS = (FLASER, ROBOT, RAW)
KINDS = (*SCANS, ODOM, TRUE)
CORRECTED = "corrected"  # of source.truth
STILL = (0.0, 0.0, 0.0)
TYPICAL_M = 100.0  # more than the median of lasers on robots, also of those that read 82 m where they met nothing
STEP_M, STEPS_LEAST = 0.02, 30  # of wheels between two scans, that tell a direction
ASIDE, AHEAD = 0.8, 0.95  # mean |cos| between way and heading: 0.64 where they have nothing to do with each other, 1
AT_END_M, BELOW_M = 0.015, 0.5  # the readings of a scanner that met nothing; what walls there would be like is judged below
END_LEAST, END_SHARE, END_TIMES = 100, 0.002, 10.0


class Log(NamedTuple):
    """Scans in the order of the file, the odometry (x, y, theta) at each; lines of true poses and where they stand; what a
    cut file no longer holds, in words."""

    readings: list[Reading]
    odometry: list[Pose]
    true: list[tuple[str, bytes]]
    cut: list[str]


def is_carmen(path: Path) -> bool:
    """A log by its ending, or a text of another ending that begins as one."""
    if not path.is_file() or path.name.lower().endswith(SUFFIXES):
        return path.is_file()
    if path.suffix.lower() not in TEXTS:
        return False
    with path.open("rb") as file:
        return any(_plain(line).startswith(SCANS) for line in file.read(LOOKED_AT).splitlines())


def open_carmen(path: Path, settings) -> Recording:
    """The scans of a CARMEN log with wheel travel between them; the first pose of the odometry is the map's origin."""
    log = _read(path, settings)
    own = [one.stamp_s for one in log.readings]
    if not own:
        with opened(path) as file:
            head = file.read(LOOKED_AT)
        kinds = {line.split()[0].decode("ascii", "replace") for line in head.splitlines() if line.split()}
        hint = "; a log of Player: play it into a CARMEN log or a ROS bag" if b"Player" in head[:HEAD_BYTES] else ""
        hint = f"; {GRAPH}" if any(kind.startswith(("VERTEX", "EDGE")) for kind in kinds) else hint
        if other := next((kind for kind in sorted(kinds) if OTHER_LASER.fullmatch(kind)), ""):
            first = "FLASER" if other == "RLASER" else f"{other[:-1]}1"
            hint = f"; of another laser alone: write {first} for it (sed s/^{other}/{first}/)"
        hint = f"; {BEESOFT}" if kinds & {"LASER-RANGE", "#LASER"} else hint
        hint = "; GMapping's own log: give the CARMEN log that it was made of" if "LASER_READING" in kinds else hint
        found = ", ".join(sorted(kinds)[:6])
        raise ConfigError(f"{path}: no FLASER, ROBOTLASER1 or RAWLASER1 line; found {found}; expected a CARMEN log with "
                          f"laser scans{hint}")
    stamps, repaired = in_file_order(own, settings.max_jump_s)
    kept = range(len(own))[settings.start :: settings.stride][: settings.count or None]
    if not kept:
        raise ConfigError(f"{path}: source.start={settings.start} but the log has {len(own)} scans")

    odometry = [se2(*pose) for pose in log.odometry]
    lasers = [se2(*(one.laser or pose)) for one, pose in zip(log.readings, log.odometry, strict=True)]
    truth = _truth(log, stamps, lasers, odometry, settings)
    mount = mount_of(settings.scan_mount, "scan_mount")
    moved = not settings.scan_mount and _constant(lasers, odometry)  # a mount that was typed is on the wheels' body
    poses = lasers if moved else odometry
    moves = len(own) == 1 or any((pose != poses[0]).any() for pose in poses)  # readings that never change are none
    wheels = moves and settings.wheel_topic != "none"

    def views():
        for index, i in enumerate(kept):
            travel = None if index == 0 or not wheels else planar(inverse(poses[kept[index - 1]]) @ poses[i])
            extras = {"log_stamp_s": np.array([own[i]])} if repaired else {}
            scan = mounted(_scan(log.readings[i]), mount, path.name)
            capture = Capture(index, float(stamps[i]), travel=travel, scan=scan, sensed=True, extras=extras)
            yield capture, truth.at(capture.stamp_s) if truth is not None else None

    facts = _facts(path, [poses[i] for i in kept], log.readings[0].max_m)
    provides = frozenset({"scan", *(["wheel"] if wheels else []), *(["log_stamp_s"] if repaired else [])})
    return Recording(NO_CAMERA, views(), len(kept), Counter(), facts, provides, lost=log.cut, repaired=repaired)


def _facts(path: Path, poses: list[np.ndarray], max_range_m: float) -> WorldFacts:
    """A world as large as the odometry says it went, a fifth more for its drift, and what the laser sees beyond."""
    away = np.array([(inverse(poses[0]) @ pose)[:2, 3] for pose in poses])
    low, high = away.min(axis=0), away.max(axis=0)
    margin = 0.2 * float((high - low).max()) + min(max_range_m, 15.0)
    west, south, east, north = (float(v) for v in (*(low - margin), *(high + margin)))
    return WorldFacts(path.name.split(".")[0], (0.0, 0.0, 0.0), (), (west, south, east, north), 0.25,
                      bounds_known=False)


def _read(path: Path, settings) -> Log:
    """What a log holds. Raises ConfigError with file and line."""
    readings: list[Reading] = []
    cut: list[str] = []
    broken: list[ConfigError] = []
    beside: dict[bytes, list[tuple[str, bytes]]] = {ODOM: [], TRUE: []}
    kind, fov_deg, step_deg, ahead_m = b"", settings.laser_fov_deg, 0.0, 0.0
    with opened(path) as file:
        number = 0
        while line := file.readline(MAX_LINE):
            number += 1
            line = _plain(line)
            if line.startswith(STEP_SAID):
                step_deg = _said(line)
            if line.startswith(AHEAD_SAID):
                ahead_m = _said(line)
            found = next((word for word in KINDS if line.startswith(word)), None)
            if found is None or (found in SCANS and found != kind and kind not in (b"", RAW)):
                continue
            where = f"{path.name}:{number}"
            if found not in SCANS:
                beside[found].append((where, line))
                continue
            words = _words(line)
            if found != kind:  # scans that carry their pose are better than those that do not
                kind, readings = found, []
                fov_deg = _fov_deg(words, step_deg, settings, path) if found == FLASER else 0.0
            try:
                readings.append(flaser(words, where, float(np.radians(fov_deg)), settings.max_laser_m) if found == FLASER
                                else robotlaser(words, where, settings.max_laser_m))
            except ConfigError as error:
                if line.endswith(b"\n"):
                    broken.append(error)
                else:
                    cut.append(f"the log is cut: its last line, {number}, is not whole")
    if broken:
        if len(broken) > MOST_BROKEN * len(readings):
            raise broken[0]
        cut.append(f"{len(broken)} line{'s are' if len(broken) > 1 else ' is'} not whole, the first: {broken[0]}")
    check_unit([one.ranges_m for one in readings], str(path))
    most_m = end_of_range([one.ranges_m[(one.ranges_m > 0.0) & (one.ranges_m < one.max_m)] for one in readings])
    readings = [one._replace(max_m=min(one.max_m, most_m)) for one in readings]
    odometry = _between(beside[ODOM], readings) if kind == RAW else [one.odometry or STILL for one in readings]
    _check_headings(np.array(odometry).reshape(-1, 3), path)
    if abs(ahead_m) > CONSTANT_M and kind != RAW and not settings.scan_mount and all(
            one.laser == one.odometry for one in readings):
        logger.warning("%s: its laser sits %g m ahead, as robot_frontlaser_offset says, and its poses are those of the "
                       "robot: type source.scan_mount=[%g,0,0,0,0,0]", path.name, ahead_m, ahead_m)
    return Log(readings, odometry, beside[TRUE], cut)


def _fov_deg(words: list[str], step_deg: float, settings, path: Path) -> float:
    """What the beams of FLASER lines, which do not say it, cover. Half a turn in whole degrees or parts of one is a SICK's
    (GMapping and others take it so, whatever the resolution in the log's PARAM lines); of other numbers that resolution is
    believed, and without one it is said what is taken."""
    beams = int(words[1]) if len(words) > 1 and words[1].isdigit() else 0
    usual = any(beams in (count, count + 1) for count in USUAL_BEAMS)
    if settings.laser_fov_deg != HALF_TURN_DEG or (usual and not step_deg):
        return float(settings.laser_fov_deg)
    said_deg = step_deg * (beams if beams % 2 == 0 else beams - 1)
    believed = 0.0 < said_deg <= 360.0 and not usual
    if usual and abs(said_deg - HALF_TURN_DEG) <= 2.0 * step_deg:
        return HALF_TURN_DEG
    why = "as the log does not say" if not step_deg else f"{'as' if believed else 'though'} the log says {step_deg:g} a beam"
    taken_deg = said_deg if believed else NARROW_DEG if beams in QUARTERS and not step_deg else HALF_TURN_DEG
    logger.warning("%s: its %d beams are taken to cover %.0f degrees, %s; if the laser sees more or less type "
                   "source.laser_fov_deg=DEGREES (Hokuyo: 240 or 270)", path.name, beams, taken_deg, why)
    return taken_deg


def check_unit(readings_m: list[np.ndarray], where: str) -> None:
    """Refuse readings in millimetres or centimetres, of which a robot would see none: nothing would stand in its way."""
    ranges = np.concatenate(readings_m or [np.empty(0)])
    typical = float(np.median(ranges[ranges > 0.0])) if (ranges > 0.0).any() else 0.0
    if typical > TYPICAL_M:
        raise ConfigError(f"{where}: a typical reading is {typical:.4g}; expected metres, of which lasers see 82 (SICK) "
                          "or 300; divide those in millimetres by 1000, in centimetres by 100")


def _check_headings(poses: np.ndarray, path: Path) -> None:
    """Refuse x, y, heading (N, 3) whose headings are degrees: read so, a robot goes where it looks, and by radians it does
    not."""
    steps = np.diff(poses[:, :2], axis=0)
    far = np.hypot(*steps.T) > STEP_M
    if far.sum() < STEPS_LEAST:
        return
    way, heading = np.arctan2(steps[far, 1], steps[far, 0]), poses[1:, 2][far]
    ahead = [float(np.abs(np.cos(way - unit * heading)).mean()) for unit in (1.0, np.pi / 180.0)]
    if ahead[0] < ASIDE and ahead[1] > AHEAD:
        raise ConfigError(f"{path}: its headings ({heading.min():.4g} to {heading.max():.4g}) are degrees: by these the "
                          "robot goes where it looks; expected radians")


def end_of_range(readings_m: list[np.ndarray]) -> float:
    """Where a scanner that met nothing says so by its largest reading: metres, inf where its scans (N,) show none.

    Walls lie anywhere: hardly one reading in a thousand is within AT_END_M of the largest. Many more there, and hardly any
    in as much again below, are a scanner's word for nothing.
    """
    ranges = np.concatenate(readings_m or [np.empty(0)])
    if not len(ranges):
        return np.inf
    first = float(ranges.max()) - AT_END_M
    at_end, below = int((ranges >= first).sum()), int(((ranges >= first - BELOW_M) & (ranges < first)).sum())
    clear = at_end >= END_LEAST and at_end > END_SHARE * len(ranges) and at_end > END_TIMES * AT_END_M / BELOW_M * below
    return first if clear else np.inf


def _plain(line: bytes) -> bytes:
    """Without what it is indented by, and with spaces for tabs."""
    return line.lstrip().replace(b"\t", b" ")


def _said(line: bytes) -> float:
    """The number in a PARAM line; 0 where it holds none."""
    try:
        value = float(_words(line)[2])
    except (IndexError, ValueError):
        return 0.0
    return value if np.isfinite(value) else 0.0


def _words(line: bytes) -> list[str]:
    return line.decode("ascii", "replace").split()


def _between(lines: list[tuple[str, bytes]], readings: list[Reading]) -> list[Pose]:
    """The odometry at each scan, between the two readings about it; always the same one where there is none."""
    wheels = [stamped_pose(_words(line), where) for where, line in lines]
    kept, _ = ascending([stamp for stamp, _ in wheels], np.inf)
    if not kept:
        return [STILL] * len(readings)
    at, poses = np.array([wheels[i][0] for i in kept]), np.array([wheels[i][1] for i in kept])
    poses[:, 2] = np.unwrap(poses[:, 2])
    scans = [one.stamp_s for one in readings]
    return list(zip(*(np.interp(scans, at, column).tolist() for column in poses.T), strict=True))


def _truth(log: Log, stamps: np.ndarray, lasers: list[np.ndarray], odometry: list[np.ndarray], settings) -> Truth | None:
    """Of the scanner: typed, corrected in the log, or a simulator's."""
    if settings.truth == CORRECTED:
        if _constant(lasers, odometry):
            raise ConfigError("source.truth=corrected: the poses in this log are its odometry's; nobody has corrected them")
        return Truth(stamps, np.array(lasers), settings.max_truth_gap_s)
    if hint := nearest(settings.truth, [CORRECTED]) if not Path(settings.truth).expanduser().exists() else "":
        raise ConfigError(f"source.truth={settings.truth}: no such file{hint}")
    if settings.truth or not log.true:
        return typed_truth(settings)
    true = [stamped_pose(_words(line), where) for where, line in log.true]
    kept, rejected = in_order([stamp for stamp, _ in true], settings.max_jump_s)
    mount = inverse(odometry[0]) @ lasers[0] if _constant(lasers, odometry) else np.eye(4)
    poses = np.array([se2(*true[i][1]) @ mount for i in kept])
    return Truth(np.array([true[i][0] for i in kept]), poses, settings.max_truth_gap_s, rejected)


def _constant(lasers: list[np.ndarray], odometry: list[np.ndarray]) -> bool:
    """The laser's poses are the odometry's moved by a constant."""
    if not lasers or not np.isfinite(lasers).all():
        return False
    mounts = inverse(np.array(odometry)) @ np.array(lasers)
    off = inverse(mounts[0]) @ mounts
    turned = np.abs(np.arctan2(off[:, 1, 0], off[:, 0, 0]))
    return bool(np.abs(off[:, :2, 3]).max() < CONSTANT_M and turned.max() < CONSTANT_RAD)


def _scan(one: Reading) -> Scan:
    """Ranges at or beyond the maximum are free space without an end (inf); not positive ones are unknown."""
    ranges = one.ranges_m
    out = np.where(ranges >= one.max_m, np.inf, np.where(ranges > 0.0, ranges, np.nan))
    out.setflags(write=False)
    return Scan(one.bearings_rad, out, one.max_m)


def opened(path: Path):
    if path.suffix == ".bz2":
        return bz2.open(path, "rb")
    return gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")
