"""Houses of HouseExpo (Li et al., arXiv:1903.09845): JSON with the corners of the floor, `verts`, in metres."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from .maps import MOST_CELLS
from .mesh_files import check_readable

CELL_M = 0.025
MARGIN_CELLS = 2
MOST_BYTES = 10 << 20


def floor_in(path: Path) -> OccupancyGrid | None:
    """The floor of a house, free, and all else a wall; None of another JSON. Raises ConfigError in one line."""
    check_readable(path, MOST_BYTES)
    try:
        plain = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: found {' '.join(str(error).split())[:80]}; expected JSON") from None
    if not isinstance(plain, dict) or "verts" not in plain:
        return None
    try:
        corners = np.array(plain["verts"], float)
    except (ValueError, TypeError):
        corners = np.zeros(0)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise ConfigError(f"{path}: verts are no corners; expected at least three [x, y], metres (HouseExpo)")
    low = corners.min(axis=0) - MARGIN_CELLS * CELL_M
    columns, rows = (np.ceil((corners.max(axis=0) - low) / CELL_M).astype(int) + MARGIN_CELLS).tolist()
    if rows * columns > MOST_CELLS:
        raise ConfigError(f"{path}: its verts span {columns * CELL_M:.0f} x {rows * CELL_M:.0f} m; expected metres")
    free = inside((corners - low) / CELL_M, (rows, columns))
    return OccupancyGrid(np.where(free, 0.0, 1.0).astype(np.float32), CELL_M, (float(low[0]), float(low[1])))


def inside(corners: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(H, W) bool of the cells of a grid whose middle is inside a polygon (N, 2), x and y in cells, by the even-odd rule
    along each row."""
    rows, columns = shape
    turns = np.zeros((rows, columns + 1), int)
    cells = corners - 0.5  # the middle of the first cell is (0, 0)
    for (x0, y0), (x1, y1) in zip(cells, np.roll(cells, -1, axis=0), strict=True):
        crossed = np.arange(max(0, int(np.ceil(min(y0, y1)))), min(rows, int(np.ceil(max(y0, y1)))))
        if len(crossed):
            at = np.ceil(x0 + (crossed - y0) * (x1 - x0) / (y1 - y0)).astype(int)
            np.add.at(turns, (crossed, np.clip(at, 0, columns)), 1)
    within: np.ndarray = np.cumsum(turns, axis=1)[:, :-1] % 2 == 1
    return within
