"""Does a path over cells touch anything blocked? Exact: every piece of it between two grid lines is looked at.

A path may touch blocked cells and run along their sides, since the shortest path does. It may not enter one deeper than
TOUCH, nor pass between two that meet, whether along a common side or through a common corner. Outside the grid is blocked.
"""

from __future__ import annotations

import numpy as np

TOUCH = 1e-7  # cells
ROUNDED = 1e-6  # of a coordinate, or metres: what a float32 rounds
LONGEST = 2_000_000  # cells a path may run through; more is no path


def with_exact_ends(points_m: np.ndarray, start_m: np.ndarray, goal_m: np.ndarray) -> np.ndarray:
    """(N, 2) points that begin and end exactly at (2,) start and goal, if they did so but for what a float32 rounds."""
    ends = np.array([start_m, goal_m])
    if len(points_m) < 2 or not np.allclose(points_m[[0, -1]], ends, rtol=ROUNDED, atol=ROUNDED):
        return points_m
    return np.vstack([ends[:1], points_m[1:-1], ends[1:]])


def mistaken_ends(points_m: np.ndarray, start_m: np.ndarray, goal_m: np.ndarray, resolution_m: float,
                  origin_m: tuple[float, float]) -> str:
    """The common mistake without which the ends of a path lie within two cells of start and goal, in words; or nothing."""
    ends, said, corner = np.array([start_m, goal_m]), points_m[[0, -1]], np.asarray(origin_m)
    cells = "are cells; metres are origin_m + resolution_m * (cell + 0.5)"
    fits = {"put start_m before and goal_m behind the middles of the cells": said, "the path is reversed": said[::-1],
            "x and y are exchanged": said[:, ::-1], f"these (column, row) {cells}": (said + 0.5) * resolution_m + corner,
            f"these (row, column) {cells}, x of the column": (said[:, ::-1] + 0.5) * resolution_m + corner,
            "origin_m is missing": said + corner, "x and y are exchanged, and origin_m is missing": said[:, ::-1] + corner}
    return next((f"; {words}" for words, other in fits.items() if np.abs(other - ends).max() <= 2.0 * resolution_m), "")


def first_blocked(points_m: np.ndarray, blocked: np.ndarray, resolution_m: float,
                  origin_m: tuple[float, float]) -> np.ndarray | None:
    """(2,) metres of the first place where the polyline (N, 2) metres is not free on `blocked` (H, W) bool, or None.

    origin_m: corner of cell (0, 0). A start inside blocked cells may be left: the path's beginning, up to the first free
    cell, is not judged if it is at most twice as long as the way to the nearest free cell's middle, and two cells.
    """
    corner = np.asarray(origin_m, float)
    xy = (points_m - corner) / resolution_m
    rows, columns = blocked.shape
    off = ((xy < -TOUCH) | (xy > (columns + TOUCH, rows + TOUCH))).any(axis=1)
    if off.any():
        return np.array(points_m[off.argmax()])
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    if steps.sum() > LONGEST:
        return np.array(points_m[-1])
    at, mid, length = _pieces(xy)
    wrong = ~_free(blocked, mid) & (length > TOUCH)
    if not _free(blocked, xy[:1])[0]:
        wrong &= ~_way_out(wrong, length, _nearest_free(blocked, xy[0]))
    if wrong.any():
        return np.array(mid[wrong.argmax()] * resolution_m + corner)
    pinched = _pinched(blocked, at)
    stuck = np.concatenate([pinched, ~_free(blocked, xy[-1:])])
    return np.array(np.vstack([at, xy[-1:]])[stuck.argmax()] * resolution_m + corner) if stuck.any() else None


def _pieces(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The polyline cut where it meets grid lines: (K, 2) cuts and bends between its ends, (P, 2) middles and (P,) lengths
    of the pieces."""
    a, b = xy[:-1], xy[1:]
    segments, shares = [np.arange(len(a)), np.arange(len(a))], [np.zeros(len(a)), np.ones(len(a))]
    for axis in (0, 1):
        low, high = np.minimum(a[:, axis], b[:, axis]), np.maximum(a[:, axis], b[:, axis])
        first = np.ceil(low)
        count = np.where(high > low, np.floor(high) - first + 1, 0).astype(int)
        segment = np.repeat(np.arange(len(a)), count)
        line = first[segment] + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        segments.append(segment)
        shares.append((line - a[segment, axis]) / (b - a)[segment, axis])
    segment, share = np.concatenate(segments), np.clip(np.concatenate(shares), 0.0, 1.0)
    order = np.lexsort((share, segment))
    segment, share = segment[order], share[order]
    at = a[segment] + share[:, None] * (b - a)[segment]
    length, same = np.linalg.norm(np.diff(at, axis=0), axis=1), segment[:-1] == segment[1:]
    along = np.concatenate([[0.0], np.cumsum(length)])[:len(at)]
    inner = at[(along > TOUCH) & (along < length.sum() - TOUCH)]
    return inner, 0.5 * (at[:-1] + at[1:])[same], length[same]


def _free(blocked: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """(N,) bool: some cell whose closure, TOUCH wide, holds the point (N, 2) is free."""
    low, high = np.floor(xy - TOUCH).astype(int), np.floor(xy + TOUCH).astype(int)
    free = np.zeros(len(xy), bool)
    for i in (low[:, 0], high[:, 0]):
        for j in (low[:, 1], high[:, 1]):
            free |= ~_blocked_at(blocked, i, j)
    return free


def _pinched(blocked: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """(N,) bool: the point is a corner where two blocked cells meet, free cells on the other diagonal."""
    corner = np.rint(xy).astype(int)
    i, j = corner.T
    sw, se = _blocked_at(blocked, i - 1, j - 1), _blocked_at(blocked, i, j - 1)
    nw, ne = _blocked_at(blocked, i - 1, j), _blocked_at(blocked, i, j)
    on_corner = (np.abs(xy - corner) <= TOUCH).all(axis=1)
    return np.asarray(on_corner & (sw == ne) & (se == nw) & (sw != se))


def _blocked_at(blocked: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    rows, columns = blocked.shape
    inside = (i >= 0) & (i < columns) & (j >= 0) & (j < rows)
    return np.asarray(~inside | blocked[np.clip(j, 0, rows - 1), np.clip(i, 0, columns - 1)])


def _way_out(wrong: np.ndarray, length: np.ndarray, nearest: float) -> np.ndarray:
    """(P,) bool: the pieces before the first free one, if they are no longer than a way out of a blocked start may be."""
    free = ~wrong & (length > TOUCH)
    count = int(free.argmax()) if free.any() else len(wrong)
    return np.arange(len(wrong)) < (count if length[:count].sum() <= 2.0 * nearest + 2.0 else 0)


def _nearest_free(blocked: np.ndarray, xy: np.ndarray) -> float:
    """Cells from a point to the middle of the nearest free cell; inf without one."""
    rows, columns = np.nonzero(~blocked)
    return float(np.hypot(columns + 0.5 - xy[0], rows + 0.5 - xy[1]).min()) if len(rows) else np.inf
