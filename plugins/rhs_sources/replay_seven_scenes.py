"""7-Scenes style folders: NAME.color.png, NAME.depth.png (16 bit, 1000 = 1 m), NAME.pose.txt (4x4 world_from_camera); also
NAME.color.jpg with NAME.depth.pgm (ScanNet's SensReader), NAME-color.png with NAME-depth.png (RGB-D Scenes).

Shotton et al., "Scene coordinate regression forests", CVPR 2013. 0 and 65535 are unknown depth; a pose that holds NaN
was never found and is unknown. The recordings have no stamps: 30 views a second.

In the data set itself depth is that of a camera beside the colour camera, and so are the poses: with
`source.camera=seven_scenes` both are carried to the colour camera (replay_register.py). Folders of this form with other
cameras are taken to be registered, but where their _info.txt says that depth has a size and numbers of its own (3RScan).
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse

from .folders.intrinsics import depth_camera_beside
from .replay_cameras import DEPTH_CAMERAS, check_pose
from .replay_register import typed_depth_camera
from .replay_stamps import Truth, number_of, rows
from .replay_tum import Recording, open_pairs

RATE_HZ = 30.0


def is_seven_scenes(path: Path) -> bool:
    return any(path.glob("[!.]*[.-]color.*"))


def open_seven_scenes(path: Path, settings) -> Recording:
    """The views of a 7-Scenes folder in the order of their names. Raises ConfigError when a depth image is missing."""
    pairs, stamps, poses, unknown = [], [], [], 0
    for number, color in enumerate(sorted(path.glob("[!.]*[.-]color.*"))):
        name, mark = re.split("[.-]color[.]", color.name)[0], color.stem[-len("color") - 1]
        depth = next((file for end in ("png", "pgm") if (file := path / f"{name}{mark}depth.{end}").is_file()), None)
        if depth is None:
            depth = path / f"{name}{mark}depth.png"
            raise ConfigError(f"{path}: {color.name} is there but {depth.name} is not; replay needs both")
        stamp = number / (settings.rate_hz or RATE_HZ)
        pairs.append((stamp, color, depth))
        pose = _pose(path / f"{name}.pose.txt")
        if pose is None:
            unknown += 1
        else:
            stamps.append(stamp)
            poses.append(pose)
    if not pairs:
        raise ConfigError(f"{path}: no view like frame-000000.color.png; expected a 7-Scenes folder (seq-01)")
    preset = DEPTH_CAMERAS.get(settings.camera) if isinstance(settings.camera, str) else None
    beside = typed_depth_camera(settings.depth_camera or depth_camera_beside(path)) or preset
    if beside is not None and poses:
        poses = list(np.array(poses) @ inverse(beside.color_from_depth))
    truth = Truth(np.array(stamps), np.array(poses).reshape(-1, 4, 4), 0.0) if poses else None
    lost = Counter(truth_unknown=unknown) if truth is not None else Counter()
    return open_pairs(pairs, settings, truth=truth, default_scale=1000.0, rejected=+lost,
                      depth_camera=beside, timed=bool(settings.rate_hz))


def _pose(path: Path) -> np.ndarray | None:
    """The 4x4 matrix of a pose file; None when there is none or it holds NaN. Refused when it is no rigid motion."""
    if not path.is_file():
        return None
    values = [number_of(word, f"{path.name}:{line}") for line, words in rows(path) for word in words]
    if len(values) != 16:
        raise ConfigError(f"{path.name}: found {len(values)} numbers; expected a 4x4 matrix")
    pose = np.array(values).reshape(4, 4)
    return check_pose(pose, path.name) if np.all(np.isfinite(pose)) else None
