"""Are the clouds of a frame that is called `map` of the scanner after all?

In the frame of a map (REP 105) somebody's estimate has put them, and the robot would seem to stand still. Some drivers give
that name to clouds as the scanner saw them. Where there are wheels, clouds a stretch of way apart are laid on each other, as
they stand and as the wheels say that the robot went: those of the scanner fit better moved (z-test of paired shares).
"""

from __future__ import annotations

import logging
from itertools import islice

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, planar, se2, transform

from . import messages as ros
from .turning import readings
from .wheels import first_with_wheels

log = logging.getLogger("rhs.replay")
WORLDS = ("map", "odom", "world", "earth", "camera_init")  # the last is LOAM's and FAST-LIO's
FEW = 50  # messages that show whether a sensor stays where it is in its frame
LOOKED_AT, APART_S = 300, 3.0  # clouds; most between two
WAY_M, TURN_RAD = 0.5, 0.3  # least between two
LEAST_PAIRS, MOST_PAIRS = 5, 20
NEAR_M, FAR_M, MOST_POINTS = 0.15, 15.0, 2000  # of partners; points that are looked at
LEAST_GAIN, LEAST_Z = 0.05, 3.0


def check_scanners_own(reader, topics, frame: str) -> bool:
    """Whether clouds are of a frame whose place on the robot tf may tell; False: of one of a bad name, which is said.
    Raises ConfigError where they are of a frame in which the robot moves, as far as can be told."""
    if frame.strip("/").split("/")[-1] not in WORLDS:
        return True
    if (topics.wheel or topics.tf) and _move_with_robot(reader, topics):
        log.warning("%s: its clouds are of the frame %s, but move with the robot: they are taken to be as the scanner saw "
                    "them, at the body (source.scan_mount=[x,y,z,roll,pitch,yaw] where it sits elsewhere)", topics.around,
                    frame)
        return False
    raise ConfigError(f"{topics.around}: its clouds are of the frame {frame}, in which the robot moves: somebody's estimate "
                      "has put them there; type source.depth_topic=NAME of clouds as the scanner saw them, or "
                      "source.scan_mount=[0,0,0,0,0,0] if these are such")


def own_place(reader, topic: str) -> np.ndarray | None:
    """4x4 frame_from_sensor of messages that say where in their frame they were seen from (Foxglove's), as the first says;
    None where it says nothing. Raises ConfigError where it moves: that is somebody's estimate."""
    first = [place_in_frame(message) for _, _, message in islice(ros.stamped(reader, {topic}), FEW)]
    if any(one != first[0] for one in first):
        raise ConfigError(f"{topic}: its messages have poses of their own that change, in one frame: somebody's estimate "
                          "has put them there; expected the frame of the sensor, or where it sits on the robot")
    return np.reshape(first[0], (4, 4)) if first and first[0] else None


def place_in_frame(message) -> tuple[float, ...]:
    """The 16 numbers of its pose in its frame; none where it sits there."""
    own = getattr(message, "own", None)
    return () if own is None else tuple(np.round(own, 9).ravel().tolist())


def _move_with_robot(reader, topics) -> bool:
    from scipy.spatial import cKDTree

    found, wheels = first_with_wheels(reader, topics.around, topics, LOOKED_AT)
    stamps, poses = readings(wheels)
    found = [one for one in found if len(stamps) and stamps[0] <= one[0] <= stamps[-1]]
    at = np.array([stamp for stamp, _ in found])
    body = [se2(*(np.interp(stamp, stamps, column) for column in poses.T)) for stamp in at]
    gains = []
    for first, second in _pairs(at, body):
        seen, other = (_thinned(ros.points_of(found[k][1], topics.around)[0]) for k in (first, second))
        if len(seen) and len(other):
            tree = cKDTree(other)
            shares = [float((tree.query(points)[0] < NEAR_M).mean())
                      for points in (seen, transform(inverse(body[second]) @ body[first], seen))]
            gains.append(shares[1] - shares[0])
    if len(gains) < LEAST_PAIRS:
        return False
    mean, error = float(np.mean(gains)), float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    return mean > LEAST_GAIN and mean > LEAST_Z * error


def _pairs(at: np.ndarray, body: list[np.ndarray]) -> list[tuple[int, int]]:
    """Of clouds at times (N,), each with the first after it by when the robot had gone or turned far enough."""
    pairs = []
    for k in range(len(at)):
        for j in range(k + 1, len(at)):
            x, y, turn = planar(inverse(body[k]) @ body[j])
            if at[j] - at[k] > APART_S:
                break
            if np.hypot(x, y) > WAY_M or abs(turn) > TURN_RAD:
                pairs.append((k, j))
                break
    return pairs[:: max(1, -(-len(pairs) // MOST_PAIRS))]


def _thinned(points: np.ndarray) -> np.ndarray:
    near = points[np.linalg.norm(points, axis=1) < FAR_M]  # NaN is not
    return near[:: max(1, len(near) // MOST_POINTS)]
