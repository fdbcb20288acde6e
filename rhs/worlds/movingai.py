"""MovingAI's grid maps (`.map`) and scenario files (`.scen`), the benchmark format of Sturtevant (2012).

A map is text: `type octile`, `height H`, `width W`, `map`, then H lines of W letters. `.` and `G` are passable, so is
`S` (swamp, at a cost that is ignored here); everything else is blocked. Coordinates are cells, x to the right and y
*down* from the first line. Here row 0 is the first line, one cell is one metre, and cell (x, y) has its centre at
(x + 0.5, y + 0.5) m: numbers of a scenario carry over, pictures are upside down.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.base.commands import check_regular
from rhs.base.errors import ConfigError

PASSABLE = b".GS"
_MOST_CELLS = 25_000_000
_MOST_BYTES = 100_000_000


@dataclass(frozen=True)
class Scenario:
    """One line of a `.scen`: start and goal as (x, y) cells, and the shortest eight-connected length in cells (diagonal
    steps of sqrt 2, corners not cut) that the file claims."""

    map_name: str
    size: tuple[int, int]
    start: tuple[int, int]
    goal: tuple[int, int]
    optimal_cells: float


def load_movingai_map(path: str | FilePath) -> OccupancyGrid:
    """The map as a grid of one-metre cells, 0 or 1. Raises ConfigError with file and line."""
    path = FilePath(path)
    lines = _read(path).splitlines()
    header: dict[str, str] = {}
    number = 0
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words == ["map"]:
            break
        if len(words) != 2 or words[0] not in ("type", "height", "width"):
            raise ConfigError(f"{path}:{number}: expected type, height, width or map, found '{line[:40]}'")
        header[words[0]] = words[1]
    else:
        raise ConfigError(f"{path}: there is no line `map`; expected a MovingAI map")
    height, width = (_count(path, header, key) for key in ("height", "width"))
    if height * width > _MOST_CELLS:
        raise ConfigError(f"{path}: {width} x {height} cells are more than the {_MOST_CELLS} allowed")
    rows = lines[number: number + height]
    for k, row in enumerate(rows):
        if len(row) != width:
            raise ConfigError(f"{path}:{number + 1 + k}: {len(row)} cells, expected {width}")
    if len(rows) < height:
        raise ConfigError(f"{path}: the map has {len(rows)} rows, expected {height}")
    letters = np.frombuffer("".join(rows).encode("latin-1"), np.uint8).reshape(height, width)
    free = np.isin(letters, np.frombuffer(PASSABLE, np.uint8))
    return OccupancyGrid(np.where(free, 0.0, 1.0).astype(np.float32), 1.0, (0.0, 0.0))


def load_scenarios(path: str | FilePath) -> list[Scenario]:
    """All problems of a `.scen`. Raises ConfigError with file and line."""
    path = FilePath(path)
    out = []
    for number, line in enumerate(_read(path).splitlines(), 1):
        words = line.split("\t") if "\t" in line else line.split()
        if not line.strip() or words[0] == "version":
            continue
        try:
            width, height, sx, sy, gx, gy = map(int, words[2:8])
            out.append(Scenario(words[1], (width, height), (sx, sy), (gx, gy), float(words[8])))
        except (ValueError, IndexError) as error:
            raise ConfigError(f"{path}:{number}: expected bucket, map, width, height, start x, y, goal x, y, optimal "
                              f"length; found '{line[:60]}'") from error
    if not out:
        raise ConfigError(f"{path}: no problem in it; expected the lines of a MovingAI scenario")
    return out


def centre_m(cell: tuple[int, int]) -> tuple[float, float]:
    """Metres of the centre of an (x, y) cell."""
    return cell[0] + 0.5, cell[1] + 0.5


def _read(path: FilePath) -> str:
    try:
        check_regular(path)
        if path.stat().st_size > _MOST_BYTES:
            raise ConfigError(f"{path}: {path.stat().st_size} bytes; at most {_MOST_BYTES} are read")
        return path.read_text(encoding="latin-1")
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error


def _count(path: FilePath, header: dict[str, str], key: str) -> int:
    text = header.get(key, "")
    if not text.isdecimal() or len(text) > 9 or not int(text):
        raise ConfigError(f"{path}: {key} is '{text[:40]}'; expected a positive whole number")
    return int(text)
