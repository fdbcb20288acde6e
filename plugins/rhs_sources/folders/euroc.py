"""EuRoC MAV folders (mav0): cam0, the IMU and the true states, each with data.csv and sensor.yaml.

Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016. The body of rhs is cam0's mount: the axes of EuRoC's own
body, its IMU, do not point ahead and up. `imu` (M, 7): stamp_s and the readings since the view before, turn rates (rad/s)
and accelerations (m/s^2) in the IMU's axes. `right_image`: cam1 at the nearest stamp, as it was recorded, not rectified;
`right_camera`: its numbers (rhs.api.stereo).
"""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, rotation_of_quaternion, se3
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

from ..replay_cameras import check_pose, chosen_camera
from ..replay_images import read_color
from ..replay_mounts import placed_camera
from ..replay_stamps import Truth, associate, in_order, number_of, read_tum_truth, rows, typed_file
from ..replay_tum import Recording, inside
from .intrinsics import camera_of_names, read_yaml
from .views import Listed, led, moved

TRUTHS = ("state_groundtruth_estimate0", "vicon0", "gt", "mocap0")  # the best first; the last two: Monado's, TUM VI's
log = logging.getLogger("rhs.replay")
CAMERAS = ("cam0", "cam1")


def is_euroc(path: Path) -> bool:
    return any((_mav0(path) / name / "data.csv").is_file() for name in CAMERAS)


def open_euroc(path: Path, settings) -> Recording:
    """The views of cam0, or of cam1 where it is alone, with the readings of the IMU between them. Raises ConfigError naming
    file and line."""
    folder = _mav0(path)
    name = next(name for name in CAMERAS if (folder / name / "data.csv").is_file())
    stamps, files, rejected = _images(folder / name, settings)
    sensor = _sensor(folder / name)
    height, width = read_color(files[0]).shape[:2]
    size = (width, height)
    recorded = _camera(sensor, folder / name, size) if settings.camera == "auto" else None
    camera = placed_camera(chosen_camera(settings.camera, size, recorded=recorded, where=str(folder)), settings)
    if (folder / "depth0").is_dir():
        log.warning("%s: depth0 is not read; for colour with depth (z, 16 bits) put links to the images into one folder: "
                    "ln -s %s/cam0/data rgb; ln -s %s/depth0/data depth", folder, folder, folder)
    imu = _imu(folder / "imu0" / "data.csv")
    truth = _truth(folder, name, sensor, settings)
    right = _right(folder, stamps, settings) if settings.stereo else {}
    beside: dict[str, np.ndarray] = {}
    second = _second(folder, sensor, camera) if right else None
    if second is not None:
        beside[RIGHT_CAMERA] = camera_numbers(second)
        rejected = rejected + Counter(unpaired=len(stamps) - len(right))
        stamps, files, right = stamps[list(right)], [files[i] for i in right], dict(enumerate(right.values()))

    def read(i: int, before: int | None) -> dict:
        extras = beside | ({RIGHT_IMAGE: read_color(right[i])} if right else {})
        if imu is not None:
            begin = stamps[before] if before is not None else -np.inf
            low, high = np.searchsorted(imu[:, 0], [begin, stamps[i]], side="right")
            extras["imu"] = imu[low if before is not None else high:high]
        return {"image": read_color(files[i]), "extras": extras}

    def pose(i: int) -> np.ndarray | None:
        return None if truth is None else moved(truth.at(float(stamps[i])), inverse(camera.body_from_camera))

    provides = {"image", "gray"} | ({"imu"} if imu is not None else set()) | ({RIGHT_IMAGE, *beside} if right else set())
    if truth is not None:
        rejected = rejected + Counter({f"truth_{k}": v for k, v in truth.rejected.items()})
    return led(Listed(str(folder), stamps, read, camera, frozenset(provides), pose, rejected, right=second), settings)


def _mav0(path: Path) -> Path:
    return path / "mav0" if (path / "mav0").is_dir() else path


def _images(folder: Path, settings) -> tuple[np.ndarray, list[Path], Counter]:
    """Stamps (seconds) and files of data.csv (`nanoseconds,name`), out of order ones rejected and counted."""
    stamps, files = [], []
    for number, words in rows(folder / "data.csv"):
        where = f"{folder.name}/data.csv:{number}"
        if len(words) < 2:
            raise ConfigError(f"{where}: found {len(words)} column(s); expected nanoseconds and a file name")
        stamps.append(1e-9 * number_of(words[0], where))
        files.append(inside(folder / "data", words[1], where))
    if not stamps:
        raise ConfigError(f"{folder}/data.csv: the list is empty; expected lines of nanoseconds and a file name")
    kept, rejected = in_order(stamps, settings.max_jump_s)
    return np.array(stamps)[kept], [files[i] for i in kept], rejected


def _sensor(folder: Path) -> dict[str, Any]:
    """The values of sensor.yaml, or of this camera in Kalibr's camchain.yaml beside mav0 or in dso (TUM VI); nothing where
    there is neither."""
    above = folder.parent.parent
    chain = next((file for place in (above / "dso", above) for file in sorted(place.glob("*camchain*.yaml"))), None)
    file = folder / "sensor.yaml"
    if not file.is_file() and (chain is None or folder.name not in CAMERAS):
        return {}
    try:
        plain = read_yaml((file if file.is_file() or chain is None else chain).read_text(encoding="utf-8-sig"))
        plain = plain if file.is_file() else plain[folder.name]
        if not isinstance(plain, dict):
            raise ValueError("no names and values")
        if "T_cam_imu" in plain:
            plain["T_BS"] = {"data": inverse(np.array(plain["T_cam_imu"], float)).ravel().tolist()}
        return plain
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        short = " ".join(str(error).split())[:100]
        raise ConfigError(f"{file if file.is_file() else chain}: cannot be read ({short}); expected EuRoC's sensor.yaml or "
                          "Kalibr's camchain.yaml") from None


def _camera(sensor: dict[str, Any], folder: Path, size: tuple[int, int]) -> Camera | None:
    if not sensor:
        return None
    try:
        return camera_of_names(sensor, size)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{folder}/sensor.yaml: {error}; expected intrinsics [fu, fv, cu, cv] and resolution [width, "
                          "height]; or type source.camera=[fx,fy,cx,cy]") from None


def _imu(file: Path) -> np.ndarray | None:
    """(M, 7) stamp_s, turn rates, accelerations in order of time; None where there is no IMU."""
    if not file.is_file():
        return None
    table = []
    for number, words in rows(file):
        where = f"imu0/data.csv:{number}"
        if len(words) < 7:
            raise ConfigError(f"{where}: found {len(words)} columns; expected nanoseconds, 3 rates and 3 accelerations")
        table.append([number_of(word, where) for word in words[:7]])
    readings = np.array(table, float).reshape(-1, 7) * [1e-9, *[1.0] * 6]
    readings = readings[np.argsort(readings[:, 0], kind="stable")]
    readings.setflags(write=False)
    return readings


def _truth(folder: Path, name: str, sensor: dict[str, Any], settings) -> Truth | None:
    """True poses of a camera (name): those of the IMU or of markers (stamp p q_wxyz ...) moved by T_BS, or a typed TUM file
    of the camera."""
    if settings.truth:
        return read_tum_truth(typed_file(settings.truth), settings)
    file = next((file for one in TRUTHS if (file := folder / one / "data.csv").is_file()), None)
    if file is None:
        if (folder / "leica0" / "data.csv").is_file():
            log.warning("%s: leica0 has positions without turns, which are no poses; no error is known", folder)
        return None
    if not sensor:
        log.warning("%s: no %s/sensor.yaml says where the camera sits among the true poses; no error is known; type "
                    "source.truth=FILE of the camera's", folder, name)
        return None
    body_from_camera = _place(sensor, folder, name, "the true poses are not the camera's; type source.truth=FILE of the "
                              "camera's")
    tracked = _sensor(file.parent)
    if "T_BS" in tracked:  # of markers, which are not on the IMU
        body_from_camera = inverse(_place(tracked, folder, file.parent.name, "its poses say nothing")) @ body_from_camera
    stamps, poses = [], []
    for number, words in rows(file):
        where = f"{file.parent.name}/data.csv:{number}"
        if len(words) < 8:
            raise ConfigError(f"{where}: found {len(words)} columns; expected nanoseconds, x, y, z, qw, qx, qy, qz, ...")
        values = [number_of(word, where) for word in words[:8]]
        try:
            turn = rotation_of_quaternion(np.array([*values[5:8], values[4]]))
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None
        poses.append(se3(turn, np.array(values[1:4])) @ body_from_camera)
        stamps.append(1e-9 * values[0])
    kept, rejected = in_order(stamps, settings.max_jump_s)
    return Truth(np.array(stamps)[kept], np.array(poses).reshape(-1, 4, 4)[kept], settings.max_truth_gap_s, rejected)


def _second(folder: Path, sensor: dict[str, Any], camera: Camera) -> Camera:
    """cam1, beside cam0 where both sensor.yaml put it."""
    other = _sensor(folder / "cam1")
    recorded = _camera(other, folder / "cam1", (camera.width, camera.height))
    if recorded is None:
        raise ConfigError(f"{folder}/cam1: no sensor.yaml, which says which camera it is; leave out "
                          "source.stereo, sensor=stereo")
    places = [_place(said, folder, name, "where the two cameras sit is not known; leave out source.stereo, sensor=stereo")
              for said, name in ((sensor, "cam0"), (other, "cam1"))]
    return replace(recorded, body_from_camera=camera.body_from_camera @ inverse(places[0]) @ places[1])


def _place(sensor: dict[str, Any], folder: Path, name: str, without: str) -> np.ndarray:
    """4x4 T_BS: EuRoC's body (its IMU) from a camera. without: what cannot be said without it."""
    try:
        matrix = np.array(sensor["T_BS"]["data"], float).reshape(4, 4)
    except (KeyError, TypeError, ValueError):
        raise ConfigError(f"{folder}/{name}/sensor.yaml: no T_BS with 16 numbers, without which {without}") from None
    return check_pose(matrix, f"{name}/sensor.yaml: T_BS")


def _right(folder: Path, stamps: np.ndarray, settings) -> dict[int, Path]:
    """View -> file of cam1 within source.max_difference_s."""
    if missing := next((name for name in CAMERAS if not (folder / name / "data.csv").is_file()), ""):
        raise ConfigError(f"source.stereo=true: {folder} holds no {missing}; leave it out")
    times, files, _ = _images(folder / "cam1", settings)
    pairs = {i: files[j] for i, j in associate(stamps, times, settings.max_difference_s)}
    if not pairs:
        raise ConfigError(f"{folder}: no view of cam0 has one of cam1 within {settings.max_difference_s:g} s; type "
                          "source.max_difference_s=SECONDS")
    return pairs
