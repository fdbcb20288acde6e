"""ICL-NUIM as POV-Ray wrote it: scene_00_0000.png, .depth (metres along the ray of each pixel, as text), .txt (the camera).

Handa et al., ICRA 2014. The axes there are x to the right, y up, z ahead, and its fy is negative; here y points down, in the
camera and in the world alike.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, se3

from ..replay_images import UnreadableImage

DEPTH = ".depth"
Y_DOWN = np.diag([1.0, -1.0, 1.0])
_NUMBERS = re.compile(r"cam_(pos|dir|up)\s*=\s*\[([^\]]*)\]")


def read_ray_depth(path: Path, camera: Camera, *, scale: float, max_depth_m: float) -> np.ndarray:
    """(H, W) float32 metres ahead, NaN unknown, of a .depth file of the camera's size. Raises UnreadableImage."""
    try:
        away = np.array(path.read_bytes().split(), np.float32)
    except (OSError, ValueError):
        away = np.zeros(0, np.float32)
    if away.size != camera.width * camera.height:
        raise UnreadableImage(f"{path}: found {away.size} numbers; expected {camera.width}x{camera.height}, a distance for "
                              "each pixel")
    depth = ahead(away.reshape(camera.height, camera.width) / scale, camera)
    return np.where((depth > 0.0) & (depth <= max_depth_m), depth, np.nan).astype(np.float32)


def ahead(away: np.ndarray, camera: Camera) -> np.ndarray:
    """Depth (H, W), of distances along the rays of the camera's pixels."""
    across, down = np.meshgrid((np.arange(camera.width) - camera.cx) / camera.fx,
                               (np.arange(camera.height) - camera.cy) / camera.fy)
    return np.asarray(away / np.sqrt(across**2 + down**2 + 1.0), away.dtype)


def ray_pose(path: Path, scale: float) -> np.ndarray | None:
    """World_from_camera (4, 4) of a view's .txt, y down; None where there is none. Raises ConfigError."""
    if not path.is_file():
        return None
    try:
        given = {key: np.array(text.replace(",", " ").split(), float)
                 for key, text in _NUMBERS.findall(path.read_text("ascii", "replace"))}
    except ValueError as error:
        raise ConfigError(f"{path}: {error}; expected cam_pos = [x, y, z] and so on") from None
    if set(given) != {"pos", "dir", "up"} or any(len(one) != 3 for one in given.values()):
        return None
    ahead = given["dir"] / np.linalg.norm(given["dir"])
    right = np.cross(given["up"], ahead)
    right /= np.linalg.norm(right)
    turn = np.column_stack([right, np.cross(ahead, right), ahead])
    return se3(Y_DOWN @ turn @ Y_DOWN, Y_DOWN @ given["pos"] / scale)


def truth_of(colors: Sequence[Path], scale: float) -> Callable[[int, float], np.ndarray | None]:
    """True poses by (line from 0, stamp), of the .txt beside each image. Raises ConfigError."""
    posed = [ray_pose(color.with_suffix(".txt"), scale) for color in colors]
    return lambda line, stamp_s: posed[line]
