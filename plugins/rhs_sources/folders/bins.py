"""Clouds in .bin files, which tell nothing of themselves: how the points of one lie there.

KITTI's are float32 x, y, z, intensity. Others begin a point with the same three and go on otherwise (nuScenes: 20 bytes,
Boreas: 24, HeLiPR: 22 and more, nothing but points: 12), or are those of NCLT (velodyne_sync: three uint16 of 5 mm from
-100 m, two bytes; its z points down, its y right) or RobotCar (four rows as long as there are points). A scanner
goes from one point to its neighbour; read in any other way than they lie, points leap about, and that tells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

KITTI, NCLT, ROWS = "16 bytes", "NCLT's, whose z pointed down", "four rows of x, y, z and intensity"
BYTES = (16, 12, 18, 20, 22, *range(24, 33), 36, 40, 48)  # a point, of those that begin with float32 x, y, z
LEAPS = 0.7  # step from point to point, of the way to their middle (medians): right ones 0.01 to 0.34, others from 1.2 on
LOOKED_AT, LEAST = 20_000, 100  # points
WORLD_M = 1e4


def layout_of(data: bytes) -> str:
    """How the points of a file lie there, in words; KITTI's where nothing tells. Raises ValueError for float64."""
    fitting = [name for name in LAYOUTS if len(data) % _size(name) == 0]
    if KITTI in fitting and _unlike(np.frombuffer(data, "<f4").reshape(-1, 4)) < 0.1 and _leap(data, ROWS) < LEAPS:
        return ROWS  # its columns, read point by point, are all of everything
    if found := next((name for name in fitting if name != ROWS and _leap(data, name) < LEAPS), ""):
        return found
    for width in (3, 4):
        if len(data) % (8 * width) == 0 and _leaps(np.frombuffer(data, "<f8").reshape(-1, width)[:, :2]) < LEAPS:
            raise ValueError(f"it looks like {width} float64 a point; write float32: points.astype('float32').tofile(...)")
    return KITTI


def points_in(data: bytes, layout: str) -> np.ndarray:
    """(N, 3) points. Raises ValueError."""
    if len(data) == 0 or len(data) % _size(layout):
        raise ValueError(f"its size is no multiple of {_size(layout)}, a point of {layout}")
    points = LAYOUTS[layout](data)
    if layout == KITTI:
        _check(np.frombuffer(data, "<f4"))
    return points


def _check(numbers: np.ndarray) -> None:
    """Refuse numbers whose columns by four are alike, and those by another width are not: points in no order."""
    unlike = {width: _unlike(numbers.reshape(-1, width)) for width in (3, 4, 5, 6) if len(numbers) % width == 0}
    likely = next(width for width, much in unlike.items() if much >= 0.8 * max(unlike.values()))  # 6 is 3 twice
    if unlike[4] < 0.3 * unlike[likely]:
        raise ValueError(f"it looks like {likely} float32 a point; four are read, x, y, z, intensity")


def _unlike(table: np.ndarray) -> float:
    """How much the columns of (N, C) differ in spread: hardly at all where a table is cut into rows of another length, for
    then each column holds some of everything."""
    good = table[np.isfinite(table).all(axis=1)].astype(float)
    return float(np.log(np.std(good, axis=0) + 1e-3).std()) if len(good) > 100 else 0.0


def _leap(data: bytes, layout: str) -> float:
    return _leaps(LAYOUTS[layout](data))


def _leaps(points: np.ndarray) -> float:
    """Typical step from a point to the next, of how far they typically are from their middle; infinite of no cloud."""
    with np.errstate(invalid="ignore"):
        points = points[:LOOKED_AT].astype(float)
    good = points[(np.abs(points) < WORLD_M).all(axis=1)]  # nan is none of these
    if len(good) < max(LEAST, 0.9 * len(points)):
        return np.inf
    away_m = np.median(np.linalg.norm(good - np.median(good, axis=0), axis=1))
    return float(np.median(np.linalg.norm(np.diff(good, axis=0), axis=1)) / max(away_m, 1e-9))


def _size(layout: str) -> int:
    """Bytes that divide a file."""
    return {NCLT: 8, ROWS: 16}.get(layout) or int(layout.split()[0])


def _beginning(size: int) -> Callable[[bytes], np.ndarray]:
    kind = np.dtype({"names": ["p"], "formats": [("<f4", 3)], "offsets": [0], "itemsize": size})

    def read(data: bytes) -> np.ndarray:
        return np.frombuffer(data, kind)["p"]

    return read


def _nclt(data: bytes) -> np.ndarray:
    points: np.ndarray = np.frombuffer(data, np.dtype([("p", "<u2", 3), ("rest", "u1", 2)]))["p"] * 0.005 - 100.0
    return points * [1.0, -1.0, -1.0]


LAYOUTS: dict[str, Callable[[bytes], np.ndarray]] = {
    **{f"{size} bytes": _beginning(size) for size in BYTES}, NCLT: _nclt,
    ROWS: lambda data: np.frombuffer(data, "<f4").reshape(4, -1)[:3].T,
}
