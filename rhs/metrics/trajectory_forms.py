"""Trajectories in the forms that people have: TUM, KITTI odometry, EuRoC, TartanAir, MulRan, g2o, TORO, Open3D.

Told apart by the first line. KITTI (Geiger et al. 2012): twelve numbers a line, the upper rows of world_from_camera,
or sixteen (Replica; four lines a pose in Open3D's trajectory.log and Neural RGB-D's poses.txt, three in SUN3D's);
stamps are those of a times.txt beside it, else the numbers of the lines in place of seconds. MulRan: a stamp before
the twelve. TartanAir: x y z qx qy qz qw without a stamp. Graphs (g2o, TORO): their vertices, numbered as they are.
EuRoC (Burri et al. 2016): commas; nanoseconds, x y z, qw qx qy qz, and whatever follows. NCLT: microseconds, x y z,
roll pitch heading. A header that names the columns is believed; exports of other programs are those of
rhs.api.pose_exports. Anything else is read as TUM.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rhs.api.geometry import rotation_of_quaternion, se2, se3
from rhs.api.pose_exports import COLMAP, LAST_ROW, joined
from rhs.api.trajectory import Trajectory, check_unit, in_tum_order, read_tum, seconds_in
from rhs.base.commands import check_regular
from rhs.base.errors import RecordingError

MATRIX, WHOLE, UNTIMED, EUROC_NUMBERS = 12, 16, 7, 8  # numbers a line
SKEW = 0.05  # a rotation may be so far from one; files are rounded
PLANAR, SPATIAL = ("VERTEX_SE2", "VERTEX2"), ("VERTEX_SE3:QUAT", "VERTEX3")  # of g2o and of TORO
EDGES = {"EDGE_SE2": 3, "EDGE2": 3, "EDGE_SE3:QUAT": 7, "EDGE3": 6}  # numbers of a pose; what follows is its information
GTSAM = 2**56 - 1  # of a key: GTSAM writes a letter above the number, and the sum has more digits than a float
Rows = list[tuple[int, list[str]]]


class Numbered(Trajectory):
    """One whose file tells no time: its stamps are the numbers of its poses."""


def read_trajectory(path: Path) -> Trajectory:
    """A trajectory in any of these forms. Raises RecordingError with file and line."""
    way, times = _read(path), path.parent / "times.txt"
    if not isinstance(way, Numbered) or not times.is_file():
        return way
    stamps = np.array([finite_numbers([word], str(times), 1, "a line")[0] for word in times.read_text("utf-8").split()])
    if len(stamps) != len(way) or (np.diff(stamps) <= 0).any():
        raise RecordingError(f"{times}: {len(stamps)} stamps for {len(way)} poses; expected as many, increasing")
    return Trajectory(stamps, way.poses)


def _read(path: Path) -> Trajectory:
    check_regular(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return read_tum(path)  # which says what is wrong
    lines = enumerate(text.splitlines(), start=1)
    rows = [(number, line.replace(",", " ").split()) for number, line in lines if line.strip() and not line.startswith("#")]
    first = rows[0][1] if rows else [""]
    if len(first) == 3 and len(rows) % 5 == 0 and [len(words) for _, words in rows[1:5]] == [4] * 4:
        logged = [(rows[k][0], [word for _, words in rows[k + 1 : k + 5] for word in words]) for k in range(0, len(rows), 5)]
        return _matrices(path, logged, 0)
    if (matrices := joined(rows)) is not rows:
        return _matrices(path, matrices, 0)
    if first[0].startswith("VERTEX"):
        return _graph(path, rows)
    if in_tum_order(text, str(path)) is not text or not _is_number(first[0]):
        way = read_tum(path)  # a header, or a form with one order
        return _counted(way) if COLMAP in text or first[0][:1] in ("{", "[") else way
    for stamped in (0, 1):  # EuRoC's has seventeen too, but no rotation there
        if len(first) - stamped in (MATRIX, WHOLE) and (not stamped or _is_rotation(first[1:])):
            return _matrices(path, rows, stamped)
    if len(first) == UNTIMED:
        return _untimed(path, rows)
    if first[0].isdigit() and text.count(",") >= (EUROC_NUMBERS - 1) * len(rows):
        return _euroc(path, rows)
    return read_tum(path)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _is_rotation(words: list[str]) -> bool:
    turn = np.array(finite_numbers(words[:MATRIX], "", MATRIX, "")).reshape(3, 4)[:, :3]
    return bool(np.abs(turn @ turn.T - np.eye(3)).max() <= SKEW and np.linalg.det(turn) > 0)


def _matrices(path: Path, rows: Rows, stamped: int) -> Trajectory:
    poses, width = np.tile(np.eye(4), (len(rows), 1, 1)), len(rows[0][1])
    stamps = np.arange(len(rows), dtype=float)
    for k, (number, words) in enumerate(rows):
        values = finite_numbers(words, f"{path}:{number}", width, "of a KITTI pose")
        if not _is_rotation(words[stamped:]):
            raise RecordingError(f"{path}:{number}: the first three columns are no rotation; expected a KITTI pose")
        ends = values[stamped + MATRIX :]
        if ends and not np.allclose(ends, LAST_ROW, atol=SKEW):
            last = " ".join(f"{value:g}" for value in ends)
            raise RecordingError(f"{path}:{number}: the last four numbers are {last}; expected 0 0 0 1 (a matrix column by "
                                 "column? write it row by row)")
        poses[k, :3] = np.array(values[stamped : stamped + MATRIX]).reshape(3, 4)
        stamps[k] = values[0] * seconds_in(values[0]) if stamped else k
    return _ascending(stamps, poses) if stamped else Numbered(stamps, poses)


def _untimed(path: Path, rows: Rows) -> Trajectory:
    poses = [_pose(finite_numbers(words, f"{path}:{number}", UNTIMED, "x y z qx qy qz qw"), f"{path}:{number}")
             for number, words in rows]
    return Numbered(np.arange(len(rows), dtype=float), np.array(poses).reshape(-1, 4, 4))


def _graph(path: Path, rows: Rows) -> Trajectory:
    numbers, poses = [], []
    for number, words in rows:
        if words[0] not in (*PLANAR, *SPATIAL):
            continue
        where, flat = f"{path}:{number}", words[0] in PLANAR
        count = 3 if flat else 6 if words[0] == SPATIAL[1] else 7
        values = finite_numbers(words[1 : 2 + count], where, 1 + count, "of a vertex")
        numbers.append(_number(words[1], values[0]))
        poses.append(se2(*values[1:]) if flat else _pose(values[1:], where))
    return _counted(_ascending(np.array(numbers), np.array(poses).reshape(-1, 4, 4)))


def edge_of(words: list[str], where: str) -> tuple[list[float], np.ndarray]:
    """The numbers of the two poses of an edge of a graph, and 4x4 first_from_second. Raises RecordingError."""
    count = EDGES[words[0]]
    values = finite_numbers(words[1 : 3 + count], where, 2 + count, "of an edge")
    pose = se2(*values[2:]) if count == 3 else _pose(values[2:], where)
    return [_number(word, value) for word, value in zip(words[1:3], values, strict=False)], pose


def _number(word: str, value: float) -> float:
    """Of a pose in a graph."""
    return float(int(word) & GTSAM) if word.isdigit() else value


def _counted(way: Trajectory) -> Trajectory:
    """A way whose poses have numbers that may be times: they are none where they count from 0."""
    counts = np.array_equal(way.stamps_s, np.arange(len(way)))
    return Numbered(way.stamps_s, way.poses) if counts else way


def _pose(values: list[float], where: str) -> np.ndarray:
    """4x4 of x y z and a quaternion qx qy qz qw, or roll, pitch and yaw."""
    from scipy.spatial.transform import Rotation

    if len(values) == UNTIMED:
        check_unit(values[3:], where)
        return se3(rotation_of_quaternion(np.array(values[3:])), np.array(values[:3]))
    return se3(Rotation.from_euler("ZYX", values[:2:-1]).as_matrix(), np.array(values[:3]))


def _euroc(path: Path, rows: Rows) -> Trajectory:
    stamps, poses = [], []
    for number, words in rows:
        where = f"{path}:{number}"
        values = finite_numbers(words[:EUROC_NUMBERS], where, EUROC_NUMBERS, "ns x y z qw qx qy qz")
        poses.append(_pose([*values[1:4], *values[5:8], values[4]], where))
        stamps.append(1e-9 * values[0])
    return _ascending(np.array(stamps), np.array(poses).reshape(-1, 4, 4))


def _ascending(stamps: np.ndarray, poses: np.ndarray) -> Trajectory:
    """By time; of equal stamps the first counts."""
    _, kept = np.unique(stamps, return_index=True)
    return Trajectory(stamps[kept], poses[kept])


def finite_numbers(words: list[str], where: str, count: int, what: str) -> list[float]:
    """So many words as numbers. Raises RecordingError with where they stand, and what they should be."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise RecordingError(f"{where}: found '{' '.join(words)[:60]}', expected {count} finite numbers {what}")
    return values
