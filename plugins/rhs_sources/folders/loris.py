"""OpenLORIS-Scene (Shi et al., ICRA 2020): where the colour camera sits on the robot, and what its wheels say.

Its true poses and its odom.txt are those of base_link (OpenLORIS-Scene, issue 22; openloris-scene-tools, issue 1).
trans_matrix.yaml lists `parent_frame`, `child_frame` and the 4x4 matrix that leads from the child to the parent. odom.txt:
stamp, place, quaternion with w last, speeds.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import rotation_of_quaternion, se3
from rhs.api.trajectory import check_unit

from ..replay_cameras import check_pose
from ..replay_mounts import Mounts
from ..replay_stamps import Truth, in_order, number_of, rows, seconds_of
from .intrinsics import LORIS, read_yaml

PLACES, WHEELS = "trans_matrix.yaml", "odom.txt"
BASE = "base_link"


def base_from_color(folder: Path) -> np.ndarray | None:
    """4x4; None of a folder without trans_matrix.yaml. Raises ConfigError."""
    file = folder / PLACES
    if not file.is_file():
        return None
    try:
        links = {one["child_frame"]: (one["parent_frame"], check_pose(
            np.array(one["matrix"]["data"], float).reshape(4, 4), f"{PLACES}: {one['child_frame']}"))
            for one in read_yaml(file.read_text(encoding="utf-8-sig"))["trans_matrix"]}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ConfigError(f"{file}: cannot be read ({' '.join(str(error).split())[:80]}); expected a list trans_matrix of "
                          "parent_frame, child_frame and matrix") from None
    pose = Mounts(links, BASE).of(LORIS)
    if pose is None:
        raise ConfigError(f"{file}: nothing joins {BASE} and {LORIS}; found {', '.join(sorted(links)) or 'nothing'}")
    return pose


def wheels(folder: Path, settings) -> Truth | None:
    """The poses that the wheels say, at their stamps; None without odom.txt. Raises ConfigError with its line."""
    file = folder / WHEELS
    if not file.is_file() or settings.wheel_topic == "none":
        return None
    stamps, poses = [], []
    for number, words in rows(file):
        where = f"{file.name}:{number}"
        if len(words) < 8:
            raise ConfigError(f"{where}: found {len(words)} columns; expected stamp, x y z, qx qy qz qw and speeds")
        values = [number_of(word, where) for word in words[1:8]]
        check_unit(values[3:], where)
        stamps.append(seconds_of(words[0], where))
        poses.append(se3(rotation_of_quaternion(np.array(values[3:])), np.array(values[:3])))
    kept, _ = in_order(stamps, settings.max_jump_s)
    return Truth(np.array(stamps)[kept], np.array(poses).reshape(-1, 4, 4)[kept], settings.max_truth_gap_s)
