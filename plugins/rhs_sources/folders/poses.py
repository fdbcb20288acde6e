"""True poses as data sets write them: 12 or 16 numbers a line (KITTI, Replica), or behind a number (KITTI-360) or
a stamp (MulRan), Open3D's trajectory.log, three lines of four numbers a view (SUN3D) or four (Neural RGB-D), a table with
the number of each view (Stray Scanner's odometry.csv), a folder of one 4x4 matrix a view (ScanNet), or of one .json (3D
Scanner App, Polycam), whose camera looks along -z with y up and is turned. Poses as the file has them; None of
one that holds NaN or infinity: it was not found.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import rotation_of_quaternion, se3
from rhs.api.pose_exports import FLIPPED, joined
from rhs.api.trajectory import check_unit, seconds_in

from ..replay_cameras import check_pose
from ..replay_stamps import number_of, rows

FILES = ("groundtruth.txt", "poses.txt", "traj.txt", "trajectory.log", "traj_w_c.txt", "lowres_wide.traj",
         "pose_intrinsic_imu.json", "odometry.csv")
FOLDERS = ("pose", "poses")
SUN3D = "extrinsics/*.txt"  # named by when they were made, the last the best
POSED = ("x", "y", "z", "qx", "qy", "qz", "qw")
PHONES = ("frame_*.json", "cameras/*.json")  # 3D Scanner App, Polycam
_NUMBER = re.compile(r"(\d+)(?:\.pose)?$")  # 12, frame_0012, frame-000012.pose
Poses = dict[int, np.ndarray | None]  # by line from 0, or by the number in the name


def poses_beside(folder: Path) -> Path | None:
    """The file, or the folder of files, of true poses in a folder of views."""
    files = (folder / name for name in FILES)
    inner = (folder / name for name in FOLDERS)
    return next((path for path in (*files, *sorted(folder.glob(SUN3D))[-1:]) if path.is_file()), None) or next(
        (path for path in inner if path.is_dir() and any(path.glob("*.txt"))), None) or next(
        (path.parent for pattern in PHONES for path in folder.glob(pattern)), None)


def poses_by_line(path: Path) -> Poses | None:
    """Of a file with 12 or 16 numbers a line, or x y z qx qy qz qw, three or four lines of four numbers a view or a
    trajectory.log; None of another. Raises ConfigError with its line."""
    table = joined(rows(path))
    width = len(table[0][1]) if table else 0
    if width == 3 and len(table) % 5 == 0:
        return _logged(table, path)
    if width not in (7, 12, 16) or (width == 7 and path.suffix == ".traj"):  # ARKitScenes' have a stamp
        return None
    out: Poses = {}
    for k, (number, words) in enumerate(table):
        where = f"{path.name}:{number}"
        if len(words) != width:
            expected = f"the {width} of a {width // 4}x4 pose" if width > 7 else "x y z qx qy qz qw"
            raise ConfigError(f"{where}: found {len(words)} numbers; expected {expected}")
        out[k] = _pose([number_of(word, where) for word in words], where)
    return out


def poses_by_first(path: Path) -> dict[float, np.ndarray | None] | None:
    """Of a file whose lines are 12 or 16 numbers behind the number of a view or a stamp, by that; None of another. Raises
    ConfigError with its line."""
    table = rows(path)
    width = len(table[0][1]) if table else 0
    if width not in (13, 17):
        return None
    out: dict[float, np.ndarray | None] = {}
    for number, words in table:
        where = f"{path.name}:{number}"
        if len(words) != width:
            raise ConfigError(f"{where}: found {len(words)} numbers; expected {width}: a number or stamp and a pose")
        first = number_of(words[0], where)
        out[first * seconds_in(first)] = _pose([number_of(word, where) for word in words[1:]], where)
    return out


def poses_by_frame(path: Path) -> dict[float, np.ndarray | None] | None:
    """Of a table whose header names a column `frame` (Stray Scanner), by that; None of another. Raises ConfigError with its
    line."""
    table = rows(path)
    names = [name.lower() for name in table[0][1]] if table else []
    if not {"frame", *POSED} <= {*names}:
        return None
    out: dict[float, np.ndarray | None] = {}
    for number, words in table[1:]:
        where = f"{path.name}:{number}"
        if len(words) != len(names):
            raise ConfigError(f"{where}: found {len(words)} columns; expected {len(names)}: {' '.join(names)}")
        said = {name: number_of(word, where) for name, word in zip(names, words, strict=True)}
        values = np.array([said[name] for name in POSED])
        check_unit(values[3:].tolist(), where)
        out[said["frame"]] = se3(rotation_of_quaternion(values[3:]), values[:3]) if np.isfinite(values).all() else None
    return out


def poses_by_number(folder: Path) -> Poses:
    """Of a folder of 4x4 matrices, or of a phone's .json, by the number in their names."""
    files = next((found for pattern in (PHONES[0], "*.txt", "*.json") if (found := sorted(folder.glob(pattern)))), [])
    named = ((_NUMBER.search(path.stem), path) for path in files)
    return {int(found[1]): _of_phone(path) if path.suffix == ".json" else _pose(
        [number_of(word, f"{path.name}:{line}") for line, words in rows(path) for word in words], path.name)
        for found, path in named if found}


def _of_phone(path: Path) -> np.ndarray | None:
    """None of a file that holds no pose."""
    try:
        plain = json.loads(path.read_text("utf-8-sig"))
        numbers = plain.get("cameraPoseARFrame") or [plain[f"t_{row}{column}"] for row in range(3) for column in range(4)]
        pose = _pose([float(number) for number in numbers], path.name)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
    return None if pose is None else pose @ FLIPPED


def _logged(table: list[tuple[int, list[str]]], path: Path) -> Poses:
    """Five lines a pose: three whole numbers, then the four rows of a matrix."""
    out: Poses = {}
    for k in range(0, len(table), 5):
        where = f"{path.name}:{table[k][0]}"
        out[k // 5] = _pose([number_of(word, where) for _, words in table[k + 1 : k + 5] for word in words], where)
    return out


def rigid(numbers: list[float], where: str) -> np.ndarray:
    """4x4 of the 12 or 16 numbers of a calibration. Raises ConfigError."""
    pose = _pose(numbers, where)
    if pose is None:
        raise ConfigError(f"{where}: holds NaN or infinity; expected a 3x4 or 4x4 pose")
    return pose


def _pose(numbers: list[float], where: str) -> np.ndarray | None:
    if len(numbers) not in (7, 12, 16):
        raise ConfigError(f"{where}: found {len(numbers)} numbers; expected a 3x4 or 4x4 pose")
    if not np.all(np.isfinite(numbers)):
        return None
    if len(numbers) == 7:
        check_unit(numbers[3:], where)
        return se3(rotation_of_quaternion(np.array(numbers[3:])), np.array(numbers[:3]))
    return check_pose(np.array([*numbers, 0.0, 0.0, 0.0, 1.0][:16], float).reshape(4, 4), where)
