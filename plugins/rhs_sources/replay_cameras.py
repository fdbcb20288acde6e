"""The cameras of well-known recordings, and what a user may write instead.

Figures: TUM RGB-D benchmark, "Intrinsic camera calibration of the Kinect" (freiburg1, freiburg2 with lens distortion;
freiburg3 images are already undistorted); PrimeSense and 7-Scenes defaults as their data sets state them; ICL-NUIM's
TUM-compatible images, which want a positive fy (ETH3D/badslam issue 59); Bonn as its page does.
"""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, orthonormal

from .folders.intrinsics import read_intrinsics
from .replay_register import DepthCamera

log = logging.getLogger("rhs.replay")
# Cameras of the Kinect kind read their rows one after the other. On the first 60 views of freiburg1_rpy the residual of
# odometry=keyframe is least for 0.02 .. 0.035 s and hardly differs in between; 0 s leaves it a tenth larger.
READOUT_S = 0.025
LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])
OFF_AXIS = 0.25  # of the width or height: principal points lie nearer to the middle, but of images that were cut

_FR1 = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
_BONN = (0.039903, -0.099343, -0.00073, -0.000144, 0.0)
_FR2 = (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)
PRESETS = {
    "tum_fr1": Camera(640, 480, 517.3, 516.5, 318.6, 255.3, distortion=_FR1, readout_s=READOUT_S),
    "tum_fr2": Camera(640, 480, 520.9, 521.0, 325.1, 249.7, distortion=_FR2, readout_s=READOUT_S),
    "tum_fr3": Camera(640, 480, 535.4, 539.2, 320.1, 247.6, readout_s=READOUT_S),
    "icl_nuim": Camera(640, 480, 481.2, 480.0, 319.5, 239.5),
    "primesense": Camera(640, 480, 525.0, 525.0, 319.5, 239.5),
    "seven_scenes": Camera(640, 480, 525.0, 525.0, 320.0, 240.0, readout_s=READOUT_S),
    "bonn": Camera(640, 480, 542.822841, 542.57687, 315.59352, 237.756098, distortion=_BONN, readout_s=READOUT_S),
}

# Bonn RGB-D Dynamic (Palazzolo et al., IROS 2019; its page): true poses are those of markers, in axes of their own; the
# camera's are T_ros^-1 T T_ros T_m. T_m as published is no rotation; the nearest one is taken.
BONN_AXES = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
BONN_MARKERS = orthonormal(np.array([[1.0157, 0.1828, -0.2389, 0.0113], [0.0009, -0.8431, -0.6413, -0.0098],
                                     [-0.3009, 0.6147, -0.8085, 0.0111], [0.0, 0.0, 0.0, 1.0]]))

# 7-Scenes: its depth has a focal length of 585 pixels and is not registered to colour (its page). Where the one camera
# stands beside the other is a Kinect's of another laboratory (LIRIS, the VOIR project), as ACE takes it (Brachmann et al.,
# CVPR 2023).
_COLOR_FROM_DEPTH = np.array([[0.99996518, 0.00267651, -0.00790410, -0.02555894],
                              [-0.00274093, 0.99996303, -0.00815045, 0.00010110],
                              [0.00788199, 0.00817183, 0.99993554, 0.00203183], [0.0, 0.0, 0.0, 1.0]])
DEPTH_CAMERAS = {"seven_scenes": DepthCamera(585.0, 585.0, 320.0, 240.0, orthonormal(_COLOR_FROM_DEPTH))}


def chosen_camera(wanted, size: tuple[int, int], *, recorded: Camera | None, where: str) -> Camera:
    """The camera to use for images of `size` (width, height): the user's, else the one the recording holds.

    Hand-held recordings have no floor: the body is the camera's mount, so only the axes differ. Raises ConfigError
    when there are no intrinsics or when they are of another image size.
    """
    width, height = size
    if isinstance(wanted, str) and wanted == "auto":
        if recorded is None:
            raise ConfigError(
                f"{where} holds no camera intrinsics;"
                f" type source.camera={'|'.join(PRESETS)}, source.camera=[fx,fy,cx,cy] or source.camera=FILE"
            )
        camera = recorded
    elif isinstance(wanted, str) and wanted in PRESETS:
        camera = PRESETS[wanted]
    elif isinstance(wanted, str):
        file = Path(wanted).expanduser()
        if not file.is_file():
            raise ConfigError(f"source.camera={wanted} is not one of auto, {', '.join(PRESETS)}, a file or [fx,fy,cx,cy]")
        camera = read_intrinsics(file, size)
    else:
        fx, fy, cx, cy, *distortion = (float(v) for v in wanted)
        if not (OFF_AXIS < cx / width < 1.0 - OFF_AXIS and OFF_AXIS < cy / height < 1.0 - OFF_AXIS):
            log.warning("source.camera: the principal point (%g, %g) lies far from the middle of images of %dx%d; are these "
                        "numbers of another size of image?", cx, cy, width, height)
        return Camera(width, height, fx, fy, cx, cy, distortion=tuple(distortion) if any(distortion) else ())
    if (camera.width, camera.height) != size:
        raise ConfigError(
            f"images in {where} are {width}x{height} but source.camera={wanted} is for {camera.width}x{camera.height};"
            f" type source.camera=[fx,fy,cx,cy] for this size"
        )
    return camera


def check_pose(pose: np.ndarray, where: str) -> np.ndarray:
    """The 4x4 pose with its rotation made exact; refused when it is not a rigid motion (S08)."""
    rotation = pose[:3, :3]
    if not np.all(np.isfinite(pose)):
        raise ConfigError(f"{where}: the pose holds NaN or infinity; expected a rigid 4x4 motion")
    if np.abs(pose[3] - LAST_ROW).max() > 1e-3:
        raise ConfigError(f"{where}: the last row of the pose is {' '.join(f'{v:g}' for v in pose[3])}; expected 0 0 0 1 "
                          "(a matrix column by column?)")
    determinant = float(np.linalg.det(rotation))
    if abs(determinant - 1.0) > 0.05 or np.abs(rotation @ rotation.T - np.eye(3)).max() > 0.05:
        raise ConfigError(f"{where}: the rotation is not in SO(3) (determinant {determinant:.3f}; expected 1)")
    u, _, vt = np.linalg.svd(rotation)
    out = pose.astype(float).copy()
    out[:3, :3], out[3] = u @ vt, LAST_ROW
    return out
