"""KITTI raw: a drive's folder (2011_09_26_drive_0005_sync) with image_02/data, velodyne_points/data and oxts/data, and the
three calib_*.txt of its day beside it. KITTI-360: data_2d_raw/NAME with image_00/data_rect, and beside data_2d_raw
calibration, data_3d_raw/NAME (clouds) and data_poses/NAME (cam0_to_world.txt).

Geiger, Lenz, Stiller and Urtasun, "Vision meets robotics: the KITTI dataset", IJRR 2013, and its development kit. The true
poses are those of the GPS and inertial unit (oxts), carried to the rectified camera 0: east, north and up of the first, by
the Mercator projection at its latitude. Images must be rectified (_sync, not _extract). KITTI-360 (Liao, Xie and Geiger,
PAMI 2022, and its scripts): cam0_to_world is of the rectified camera 0, calib_cam_to_velo of the one that is not.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, se3

from ..replay_cameras import check_pose
from ..replay_images import read_color
from ..replay_stamps import in_file_order, number_of, rows, seconds_of
from ..replay_tum import Recording
from .kitti import Drive, P, drive
from .poses import Poses, poses_by_first, rigid
from .views import At, numbered, truth_of

EARTH_M = 6378137.0  # radius, as the development kit has it
OXTS = 30  # numbers a packet; the first six are latitude and longitude (degrees), height, roll, pitch and yaw
CLOUDS = "velodyne_points"
STAMP = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d+)?")
TIMES, MOST_STEP_S = ("timestamps.txt", "times.txt", "timestamps.csv", "times.csv"), 10.0
PLAIN = re.compile(r"(\d+\s+)?\d+(\.\d*)?([eE][-+]?\d+)?")  # a time, or the number of a view and one
HEADER = re.compile(r"[A-Za-z_\s()\[\]]+")  # names of columns
log = logging.getLogger("rhs.replay")


def is_kitti_raw(path: Path) -> bool:
    clouds = (path / CLOUDS / "data").is_dir() and (_day(path) is not None or _is_360(path))
    return clouds or any(_images(path, name).is_dir() for name in ("P2", "P0")) or _rectified(path, "P0").is_dir()


def open_kitti_raw(path: Path, settings) -> Recording:
    """The views of a drive, as those of KITTI odometry. Raises ConfigError."""
    if _is_360(path) or _rectified(path, "P0").is_dir():
        return drive(_of_360(path, settings), settings)
    day = _day(path)
    if day is None:
        raise ConfigError(f"{path}: no calib_cam_to_cam.txt in it or beside it; unpack the calibration of that day (for "
                          "example 2011_09_26_calib.zip) so that it lies beside the drives")
    cameras = {name: _images(path, name) for name in P}
    said = _named(day / "calib_cam_to_cam.txt")
    for name in ("P2", "P0"):
        _check_size(cameras[name], said.get(f"S_rect_0{name[-1]}"), path)
    calib = {name: said[key] for name in P if len(said.get(key := f"P_rect_0{name[-1]}", ())) == 12}
    camera_from_velodyne = None
    if (day / "calib_velo_to_cam.txt").is_file():
        rectified = se3(_numbers(said, "R_rect_00", 9, "calib_cam_to_cam.txt").reshape(3, 3), np.zeros(3))
        camera_from_velodyne = check_pose(rectified, "R_rect_00") @ _rigid(day / "calib_velo_to_cam.txt")
        calib["Tr"] = list(camera_from_velodyne[:3].ravel())

    def truth() -> tuple[At, Counter]:
        if settings.truth or camera_from_velodyne is None or not (day / "calib_imu_to_velo.txt").is_file():
            return truth_of(None, settings)
        poses = _true(path / "oxts" / "data", camera_from_velodyne @ _rigid(day / "calib_imu_to_velo.txt"))
        return (lambda number, stamp_s: poses.get(number)), Counter()

    def stamps(name: str, numbers: list[int]) -> tuple[np.ndarray, Counter]:
        return drive_stamps((cameras[name].parent if name else path / CLOUDS) / "timestamps.txt", numbers, settings)

    return drive(Drive(path, cameras, path / CLOUDS / "data", calib, "calib_cam_to_cam.txt", stamps, truth), settings)


def _of_360(path: Path, settings) -> Drive:
    """A drive of KITTI-360, by its images (data_2d_raw) or its clouds alone (data_3d_raw)."""
    root, name = path.resolve().parent.parent, path.resolve().name
    if not _is_360(path):
        raise ConfigError(f"{path}: no ../../calibration/perspective.txt; unpack KITTI-360's calibration beside "
                          f"data_2d_raw, or type source.path={path / 'image_00'} for its images alone")
    said = _named(root / "calibration" / "perspective.txt")
    cameras = {one: _rectified(path, one) for one in P}
    _check_size(cameras["P0"], said.get("S_rect_00"), path)
    calib = {one: said[key] for one in ("P0", "P1") if len(said.get(key := f"P_rect_0{one[-1]}", ())) == 12}
    place, poses = root / "calibration" / "calib_cam_to_velo.txt", root / "data_poses" / name / "cam0_to_world.txt"
    if place.is_file():
        turn = check_pose(se3(_numbers(said, "R_rect_00", 9, "perspective.txt").reshape(3, 3), np.zeros(3)), "R_rect_00")
        numbers = [number_of(word, place.name) for _, words in rows(place) for word in words]
        calib["Tr"] = list((turn @ inverse(rigid(numbers, str(place))))[:3].ravel())

    def truth() -> tuple[At, Counter]:
        first = None if settings.truth or not poses.is_file() else poses_by_first(poses)
        return truth_of(None, settings) if first is None else ((lambda number, stamp_s: first.get(number)), Counter())

    def stamps(one: str, numbers: list[int]) -> tuple[np.ndarray, Counter]:
        return drive_stamps((cameras[one].parent if one else path / CLOUDS) / "timestamps.txt", numbers, settings)

    return Drive(path, cameras, root / "data_3d_raw" / name / CLOUDS / "data", calib, "perspective.txt", stamps, truth)


def _is_360(path: Path) -> bool:
    return (path.resolve().parent.parent / "calibration" / "perspective.txt").is_file()


def _images(path: Path, name: str) -> Path:
    return path / f"image_0{name[-1]}" / "data"


def _rectified(path: Path, name: str) -> Path:
    return path / f"image_0{name[-1]}" / "data_rect"


def _day(path: Path) -> Path | None:
    """The folder that holds the calibration: the drive's own, or the one of its day."""
    return next((folder for folder in (path, path.resolve().parent) if (folder / "calib_cam_to_cam.txt").is_file()), None)


def _named(file: Path) -> dict[str, list[float]]:
    """Name -> numbers of lines `name: 1 2 3`; other lines (calib_time) are left out."""
    out = {}
    for number, words in rows(file):
        if words[0].endswith(":") and words[0] != "calib_time:":
            out[words[0][:-1]] = [number_of(word, f"{file.name}:{number}") for word in words[1:]]
    return out


def _numbers(said: dict[str, list[float]], name: str, count: int, where: str) -> np.ndarray:
    if len(said.get(name, ())) != count:
        raise ConfigError(f"{where}: found {len(said.get(name, ()))} numbers of {name}; expected {count}")
    return np.array(said[name])


def _rigid(file: Path) -> np.ndarray:
    """4x4 of the R and T of a calibration."""
    said = _named(file)
    return check_pose(se3(_numbers(said, "R", 9, file.name).reshape(3, 3), _numbers(said, "T", 3, file.name)), file.name)


def _check_size(folder: Path, said: list[float] | None, path: Path) -> None:
    """Images of another size than the rectified ones are not rectified."""
    first = next(iter(numbered(folder.glob("*.png"))), None)
    if first is None or said is None:
        return
    height, width = read_color(first[1]).shape[:2]
    if [width, height] != said:
        raise ConfigError(f"{path}: images are {width}x{height} but rectified ones {said[0]:.0f}x{said[1]:.0f} "
                          "(calib_cam_to_cam.txt: S_rect); expected a _sync drive, as it was unpacked")


def _true(folder: Path, camera_from_imu: np.ndarray) -> Poses:
    """World_from_camera by number, as oxts has them; empty without it."""
    out: Poses = {}
    origin = None
    for number, file in numbered(folder.glob("*.txt")):
        words = [word for _, line in rows(file) for word in line]
        if len(words) != OXTS:
            raise ConfigError(f"oxts/data/{file.name}: found {len(words)} numbers; expected the {OXTS} of an OXTS packet")
        latitude, longitude, height_m, *angles = (number_of(word, file.name) for word in words[:6])
        if not np.all(np.isfinite([latitude, longitude, height_m, *angles])) or not abs(latitude) < 90.0:
            continue
        if origin is None:
            scale_m = EARTH_M * np.cos(np.radians(latitude))
        place = np.array([scale_m * np.radians(longitude),
                          scale_m * np.log(np.tan(np.radians(45.0 + 0.5 * latitude))), height_m])
        origin = place if origin is None else origin
        turn = Rotation.from_euler("ZYX", angles[::-1]).as_matrix()
        out[int(float(number))] = se3(turn, place - origin) @ inverse(camera_from_imu)
    return out


def times_beside(path: Path, settings, *, say: bool = True) -> Path | None:
    """The timestamps or times (.txt, .csv) of numbered images or clouds, in their folder or one up: a time a line
    (KITTI-360), or a number of theirs and a time; None where a rate is typed. One of another form is said to be left out."""
    file = next((place / name for place in (path, path.parent) for name in TIMES if (place / name).is_file()), None)
    if settings.rate_hz or file is None:
        return None
    text = file.read_text("utf-8", "replace")
    lines = [line.replace(",", " ") for line in text.splitlines() if line.strip() and not line.startswith("#")]
    first = next(iter(lines[1:2] if lines and HEADER.fullmatch(lines[0]) else lines), "")
    if STAMP.match(text) or PLAIN.fullmatch(first.strip()):
        return file
    if say:
        log.warning("%s is left out: found %r; expected a time a line, or the number of a view and its time", file,
                    first[:40])
    return None


def drive_stamps(file: Path, numbers: list[int], settings) -> tuple[np.ndarray, Counter]:
    """Seconds of the views by their numbers, lines of timestamps.txt from 0, or in their order where there are as many; 10 a
    second, or source.rate_hz, without it. Raises ConfigError."""
    if settings.rate_hz or not file.is_file():
        return np.array(numbers) / (settings.rate_hz or 10.0), Counter()
    times: dict[int, float] = {}
    for line, words in rows(file, str):
        text, where = " ".join(words), f"{file.parent.name}/{file.name}:{line}"
        if not times and HEADER.fullmatch(text):
            continue
        if PLAIN.fullmatch(text):
            times[int(words[0]) if len(words) == 2 else len(times)] = seconds_of(words[-1], where)
        elif STAMP.fullmatch(text):
            times[len(times)] = 1e-9 * float(np.datetime64(text, "ns").astype(np.int64))
        else:
            raise ConfigError(f"{where}: found {text[:40]!r}; expected 2011-09-26 13:02:25.9, or seconds")
    if not times.keys() >= {*numbers} and len(times) == len(numbers):  # images that count from 1
        times = dict(zip(numbers, times.values(), strict=True))
    if missing := {*numbers} - times.keys():
        raise ConfigError(f"{file}: {len(times)} lines but the last view is number {max(missing)}; expected one of each "
                          "view; type source.rate_hz=VIEWS_A_SECOND to go without")
    stamps = [times[n] for n in numbers]
    if len(stamps) > 1 and (step := float(np.median(np.abs(np.diff(stamps))))) > MOST_STEP_S:
        raise ConfigError(f"{file}: its times are {step:g} apart; expected seconds; type source.rate_hz=VIEWS_A_SECOND to "
                          "go without")
    return in_file_order(stamps, settings.max_jump_s)
