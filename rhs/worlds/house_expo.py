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
    return _filled(corners, path)


def _filled(corners_m: np.ndarray, path: Path) -> OccupancyGrid:
    """Cells are free whose middle is inside, by the even-odd rule along each row."""
    low = corners_m.min(axis=0) - MARGIN_CELLS * CELL_M
    columns, rows = (np.ceil((corners_m.max(axis=0) - low) / CELL_M).astype(int) + MARGIN_CELLS).tolist()
    if rows * columns > MOST_CELLS:
        raise ConfigError(f"{path}: its verts span {columns * CELL_M:.0f} x {rows * CELL_M:.0f} m; expected metres")
    turns = np.zeros((rows, columns), int)
    cells = (corners_m - low) / CELL_M - 0.5  # the middle of the first cell is (0, 0)
    for (x0, y0), (x1, y1) in zip(cells, np.roll(cells, -1, axis=0), strict=True):
        crossed = np.arange(max(0, int(np.ceil(min(y0, y1)))), int(np.ceil(max(y0, y1))))
        if len(crossed):
            np.add.at(turns, (crossed, np.ceil(x0 + (crossed - y0) * (x1 - x0) / (y1 - y0)).astype(int)), 1)
    outside = np.cumsum(turns, axis=1) % 2 == 0
    return OccupancyGrid(outside.astype(np.float32), CELL_M, (float(low[0]), float(low[1])))
