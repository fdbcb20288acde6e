"""Folders of point clouds for `sensor=lidar`: .pcd, .bin (bins.py) or .ply, one file a view.

The body is the scanner, x ahead, y left, z up, unless `source.scan_mount` says where that sits. Files come in the order of
the numbers in their names, which are the stamps where they are times; else `source.rate_hz` a second, or 10.
"""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError

from ..carmen.log import NO_CAMERA
from ..replay_mounts import mount_of
from ..replay_stamps import cloud_extras, in_order
from ..replay_tum import Recording
from .bins import KITTI, NCLT, ROWS, layout_of
from .kitti_raw import drive_stamps, times_beside
from .pcd import SUFFIXES, read_cloud, viewpoint_of
from .views import Listed, led, numbered, one_series, stamps_by_name, truth_of

FOLDERS = ("velodyne", "velodyne_points", "lidar", "pcd", "clouds", "points", "data")
RATE_HZ = 10.0
LOOKED_AT = 10  # files
FLAT_M, SOME = 1e-3, 100  # height of a flat laser's cloud; points that tell
FURTHEST_M = 400.0  # that lidars on robots and cars see; in millimetres that is an arm's length
MOVED_M = 3.0  # a viewpoint nearer by is where the scanner sits on its robot

log = logging.getLogger("rhs.replay")


def is_clouds(path: Path) -> bool:
    return path.is_dir() and bool(_files(path))


def open_clouds(path: Path, settings) -> Recording:
    """The clouds of a folder. Raises ConfigError when the first cannot be read."""
    files = _files(path)
    if not files:
        raise ConfigError(f"{path}: no numbered cloud; expected 000000.pcd, .bin or .ply")
    one_series(files)
    _check_frame([file for _, file in files])
    numbers = [number for number, _ in files]
    stamps, timed = stamps_by_name(numbers, settings.rate_hz, RATE_HZ)
    kept, rejected = in_order(stamps, settings.max_jump_s) if timed else (list(range(len(files))), Counter())
    repaired: Counter = Counter()
    if not timed and (beside := times_beside(files[0][1].parent, settings)) is not None:
        stamps, repaired = drive_stamps(beside, [int(float(number)) for number in numbers], settings)
        timed = True
    timed = timed or bool(settings.rate_hz)
    found = next((path / name for name in ("groundtruth.txt", "poses.txt") if (path / name).is_file()), None)
    true, counts = truth_of(found, settings, numbers, untimed=not timed)
    mount = mount_of(settings.scan_mount, "scan_mount")
    layout = _layout([file for _, file in files])

    def read(i: int, before: int | None) -> dict:
        return {"extras": cloud_extras(*read_cloud(files[kept[i]][1], layout), float(stamps[kept[i]]), mount)}

    def pose(i: int) -> np.ndarray | None:
        return true(kept[i], float(stamps[kept[i]]))

    first = read(0, None)["extras"]
    check_solid(first["cloud"], files[kept[0]][1].name)
    provides = frozenset(first)
    return led(Listed(str(path), stamps[kept], read, NO_CAMERA, provides, pose, rejected + counts, repaired,
                      timed=timed), settings)


def check_solid(points: np.ndarray, where: str) -> None:
    """Refuse a cloud (N, 3) that lies in one plane: a flat scanner's, of which a lidar's odometry makes nothing; and one in
    millimetres, or in the coordinates of a country, of which all points are out of reach."""
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < SOME:
        return
    if (far := float(np.median(np.linalg.norm(points, axis=1)))) > FURTHEST_M:
        raise ConfigError(f"{where}: points are {far:.4g} m away typically; expected metres from the scanner (divide "
                          "millimetres by 1000)")
    if np.ptp(points[:, 2]) < FLAT_M:
        raise ConfigError(f"{where}: all points lie in one plane: a flat laser's? record its LaserScan, or make one by "
                          "pointcloud_to_laserscan, and type sensor=laser")


def _layout(files: list[Path]) -> str:
    """How the points of .bin files lie there, by the largest of the first ones; said where it is not as KITTI's."""
    if files[0].suffix.lower() != ".bin":
        return KITTI
    file = max(files[:LOOKED_AT], key=lambda file: file.stat().st_size)
    try:
        layout = layout_of(file.read_bytes())
    except ValueError as error:
        raise ConfigError(f"{file}: {error}") from None
    if layout != KITTI:
        log.warning("%s: its points lie on one another as in files of %s, and are read so; no times of theirs are read",
                    file.parent.name, layout if layout in (NCLT, ROWS) else f"{layout} a point")
    return layout


def _check_frame(files: list[Path]) -> None:
    """Refuse clouds that lie round the VIEWPOINT that their files tell, not round their own origin: they were moved into one
    world, and would show a scanner that stands still."""
    for file in (files[0], files[len(files) // 2], files[-1]):
        at = viewpoint_of(file)
        if at is None or np.linalg.norm(at) < MOVED_M:
            continue
        points = read_cloud(file)[0]
        here, there = (float(np.median(np.linalg.norm(points - middle, axis=1))) for middle in (np.zeros(3), at))
        if there < here:
            raise ConfigError(f"{file}: its points lie round its VIEWPOINT ({at[0]:g} {at[1]:g} {at[2]:g}): they were moved "
                              "into one world; expected clouds as the scanner saw them, itself at 0 0 0")


def _files(path: Path) -> list[tuple[str, Path]]:
    """Numbered clouds of one kind in the folder, or in one that is usual for them."""
    for folder in (path, *(path / name for name in FOLDERS), *(path / name / "data" for name in FOLDERS)):
        if folder.is_dir():
            for suffix in SUFFIXES:
                of_kind = (p for p in folder.iterdir() if p.suffix.lower() == suffix)
                found = numbered(of_kind, tail=".pcd")  # nuScenes: NAME.pcd.bin
                if found:
                    return found
    return []
