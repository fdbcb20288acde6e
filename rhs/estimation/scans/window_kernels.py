"""Compiled parts of rhs.estimation.scans.window_search: a field of closeness to walls, its bounds, scores. Loads numba."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import typed

_POINTS, _NUMBERS = nb.float64[:, ::1], nb.float64[::1]
_FIELD = nb.float32[:, ::1]
BLOCK = 5  # cells of the side of a block that one bound speaks for
AGAIN = BLOCK * BLOCK  # of a block of blocks


@typed(_FIELD(_POINTS, nb.float64, nb.float64, nb.int64, nb.int64, nb.float64, nb.float64))
def stamped(points: np.ndarray, west: float, south: float, rows: int, columns: int, cell_m: float,
            sigma_m: float) -> np.ndarray:
    """(rows, columns) exp(-d^2 / 2 sigma^2) of the nearest point, 0 beyond three sigmas."""
    nearest = np.full((rows, columns), np.inf)  # its square
    reach = int(np.ceil(3.0 * sigma_m / cell_m))
    for i in range(len(points)):
        x, y = (points[i, 0] - west) / cell_m, (points[i, 1] - south) / cell_m
        for row in range(max(int(y) - reach, 0), min(int(y) + reach + 1, rows)):
            for column in range(max(int(x) - reach, 0), min(int(x) + reach + 1, columns)):
                d2 = ((row + 0.5 - y) ** 2 + (column + 0.5 - x) ** 2) * cell_m**2
                if d2 < nearest[row, column]:
                    nearest[row, column] = d2
    field = np.zeros((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            if nearest[row, column] < np.inf:
                field[row, column] = np.float32(np.exp(-0.5 * nearest[row, column] / sigma_m**2))
    return field


@typed(nb.float64(_FIELD, _POINTS, nb.float64, nb.float64))
def _mean(field: np.ndarray, cells: np.ndarray, dx: float, dy: float) -> float:
    rows, columns = field.shape
    total = 0.0
    for i in range(len(cells)):
        x, y = int(np.floor(cells[i, 0] + dx)), int(np.floor(cells[i, 1] + dy))
        if 0 <= x < columns and 0 <= y < rows:
            total += field[y, x]
    return total / max(len(cells), 1)


def bounded(field: np.ndarray) -> np.ndarray:
    """Of each cell the largest of the BLOCK x BLOCK cells from it on to the north and the east."""
    return _largest(np.pad(field, ((0, BLOCK), (0, BLOCK))), field.shape, range(BLOCK))


def bounded_again(coarse: np.ndarray) -> np.ndarray:
    """The same of BLOCK x BLOCK blocks: of a field of bounds the largest of those a block apart. It begins AGAIN cells
    further south and west, because a block that begins beside the field may reach into it."""
    rows, columns = coarse.shape
    return _largest(np.pad(coarse, AGAIN), (rows + AGAIN, columns + AGAIN), range(0, AGAIN, BLOCK))


def _largest(padded: np.ndarray, shape: tuple[int, ...], shifts: range) -> np.ndarray:
    """Of each cell of that shape the largest of those so far to the north and so far to the east of it."""
    east = np.maximum.reduce([padded[:, k:k + shape[1]] for k in shifts])
    largest: np.ndarray = np.maximum.reduce([east[k:k + shape[0]] for k in shifts])
    return largest


@typed(nb.types.Tuple((_POINTS, nb.float64[:, :, ::1]))(nb.types.UniTuple(_FIELD, 2), _POINTS, _NUMBERS, _NUMBERS, nb.int64,
                                                        nb.float64))
def bounds_of(coarse: tuple[np.ndarray, np.ndarray], cells: np.ndarray, centre: np.ndarray, yaws: np.ndarray, blocks: int,
              least: float) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of each yaw (K, 2), and the bound (K, 2 blocks + 1, 2 blocks + 1) of each block of shifts, 0 where a
    bound of BLOCK x BLOCK of them is less than `least` already. coarse: the fields of both bounds; cells: points in cells
    from the body; centre: where the body is, in cells."""
    turns, out = np.empty((len(yaws), 2)), np.zeros((len(yaws), 2 * blocks + 1, 2 * blocks + 1))
    turned = np.empty_like(cells)
    for k in range(len(yaws)):
        c, s = np.cos(yaws[k]), np.sin(yaws[k])
        turns[k, 0], turns[k, 1] = c, s
        for i in range(len(cells)):
            turned[i, 0] = centre[0] + c * cells[i, 0] - s * cells[i, 1]
            turned[i, 1] = centre[1] + s * cells[i, 0] + c * cells[i, 1]
        for south in range(0, 2 * blocks + 1, BLOCK):
            for west in range(0, 2 * blocks + 1, BLOCK):
                dx, dy = float((west - blocks) * BLOCK), float((south - blocks) * BLOCK)
                if blocks > BLOCK and _mean(coarse[1], turned, dx + AGAIN, dy + AGAIN) < least:
                    continue
                for row in range(south, min(south + BLOCK, 2 * blocks + 1)):
                    for column in range(west, min(west + BLOCK, 2 * blocks + 1)):
                        dx, dy = float((column - blocks) * BLOCK), float((row - blocks) * BLOCK)
                        out[k, row, column] = _mean(coarse[0], turned, dx, dy)
    return turns, out


@typed(_POINTS(_FIELD, _POINTS, _NUMBERS, _POINTS, _POINTS, nb.float64, nb.float64))
def best_of(field: np.ndarray, cells: np.ndarray, centre: np.ndarray, turns: np.ndarray, tries: np.ndarray, least: float,
            keep: float) -> np.ndarray:
    """(M, 4) shift x and y in cells, place of the yaw, score: the best of each block tried that scores more than `least`
    and than `keep` of the best so far. tries (T, 4): place of the yaw, shift of the block, its bound, best bound first."""
    out, count, best = np.empty((len(tries), 4)), 0, least / keep
    turned = np.empty_like(cells)
    for t in range(len(tries)):
        if tries[t, 3] < keep * best:
            break
        k = int(tries[t, 0])
        c, s = turns[k, 0], turns[k, 1]
        for i in range(len(cells)):
            turned[i, 0] = centre[0] + c * cells[i, 0] - s * cells[i, 1]
            turned[i, 1] = centre[1] + s * cells[i, 0] + c * cells[i, 1]
        top, top_x, top_y = -1.0, 0.0, 0.0
        for dy in range(BLOCK):
            for dx in range(BLOCK):
                score = _mean(field, turned, tries[t, 1] + dx, tries[t, 2] + dy)
                if score > top:
                    top, top_x, top_y = score, tries[t, 1] + dx, tries[t, 2] + dy
        if top >= keep * best:
            out[count, 0], out[count, 1], out[count, 2], out[count, 3] = top_x, top_y, float(k), top
            count += 1
            best = max(best, top)
    return out[:count].copy()
