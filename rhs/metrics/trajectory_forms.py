"""Trajectories in the forms that people have: TUM, KITTI odometry and EuRoC.

KITTI (Geiger et al. 2012): twelve numbers a line, the upper rows of world_from_camera; stamps are those of a times.txt
beside it, else the numbers of the lines in place of seconds. EuRoC (Burri et al. 2016): commas; nanoseconds, x y z,
qw qx qy qz, and whatever follows. A header that names the columns is believed. Anything else is read as TUM.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rhs.api.geometry import rotation_of_quaternion, se3
from rhs.api.trajectory import Trajectory, in_tum_order, read_tum
from rhs.base.commands import check_regular
from rhs.base.errors import RecordingError

KITTI_NUMBERS, EUROC_NUMBERS = 12, 8
SKEW = 0.05  # a rotation may be so far from one; files are rounded


def read_trajectory(path: Path) -> Trajectory:
    """A trajectory in any of the three forms, told apart by its first line. Raises RecordingError with file and line."""
    check_regular(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return read_tum(path)  # which says what is wrong
    if in_tum_order(text) is not text:  # a header says which column is which
        return read_tum(path)
    lines = enumerate(text.splitlines(), start=1)
    rows = [(number, line) for number, line in lines if line.strip() and not line.startswith("#")]
    first = rows[0][1] if rows else ""
    if len(first.split()) == KITTI_NUMBERS:
        return _kitti(path, rows)
    if first.count(",") >= EUROC_NUMBERS - 1 and first.split(",")[0].strip().isdigit():
        return _euroc(path, rows)
    return read_tum(path)


def _kitti(path: Path, rows: list[tuple[int, str]]) -> Trajectory:
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for k, (number, line) in enumerate(rows):
        values = finite_numbers(line.split(), f"{path}:{number}", KITTI_NUMBERS, "of a KITTI pose")
        pose = np.array(values).reshape(3, 4)
        if np.abs(pose[:, :3] @ pose[:, :3].T - np.eye(3)).max() > SKEW or np.linalg.det(pose[:, :3]) < 0:
            raise RecordingError(f"{path}:{number}: the first three columns are no rotation; expected a KITTI pose")
        poses[k, :3] = pose
    times = path.parent / "times.txt"
    stamps = np.arange(len(rows), dtype=float)
    if times.is_file():
        stamps = np.array([finite_numbers([word], str(times), 1, "a line")[0] for word in times.read_text("utf-8").split()])
        if len(stamps) != len(rows) or (np.diff(stamps) <= 0).any():
            raise RecordingError(f"{times}: {len(stamps)} stamps for {len(rows)} poses; expected as many, increasing")
    return Trajectory(stamps, poses)


def _euroc(path: Path, rows: list[tuple[int, str]]) -> Trajectory:
    stamps, poses = [], []
    for number, line in rows:
        where = f"{path}:{number}"
        values = finite_numbers(line.split(",")[:EUROC_NUMBERS], where, EUROC_NUMBERS, "ns x y z qw qx qy qz")
        try:
            rotation = rotation_of_quaternion(np.array([*values[5:8], values[4]]))
        except ValueError as error:
            raise RecordingError(f"{where}: {error}") from None
        stamps.append(1e-9 * values[0])
        poses.append(se3(rotation, np.array(values[1:4])))
    _, kept = np.unique(np.array(stamps), return_index=True)
    return Trajectory(np.array(stamps)[kept], np.array(poses).reshape(-1, 4, 4)[kept])


def finite_numbers(words: list[str], where: str, count: int, what: str) -> list[float]:
    """So many words as numbers. Raises RecordingError with where they stand, and what they should be."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise RecordingError(f"{where}: found '{' '.join(words)[:60]}', expected {count} finite numbers {what}")
    return values
