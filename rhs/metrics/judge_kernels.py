"""Compiled inner loops of path_judge. Coordinates are cells of a grid with a blocked border; cell (i, j) is [i, i+1)."""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import INNER, inner, typed

TOUCH = 1e-7  # cells: overlaps below this are touches, not crossings
_GRID = nb.types.Array(nb.uint8, 2, "C")
_POINTS = nb.types.Array(nb.float64, 2, "C")


@typed(nb.boolean(_GRID, nb.float64, nb.float64))
def point_free(grid, x, y):
    """Some cell whose closure holds the point is free."""
    rows, columns = grid.shape
    if not (1.0 <= x <= columns - 1.0 and 1.0 <= y <= rows - 1.0):
        return False
    for i in range(int(np.ceil(x)) - 1, int(np.floor(x)) + 1):
        for j in range(int(np.ceil(y)) - 1, int(np.floor(y)) + 1):
            if grid[j, i] == 0:
                return True
    return False


@typed(nb.boolean(_GRID, nb.int64, nb.int64), **INNER)
def pinched(grid, i, j):
    """The lattice point (i, j) is where two blocked cells meet corner to corner, free cells on the other diagonal."""
    sw, se, nw, ne = grid[j - 1, i - 1], grid[j - 1, i], grid[j, i - 1], grid[j, i]
    return (sw and ne and not se and not nw) or (se and nw and not sw and not ne)


@typed(nb.boolean(_GRID, nb.float64, nb.float64, nb.float64, nb.float64), **INNER)
def _along_line_free(grid, fixed, low, high, vertical):
    """A segment lying on a grid line: free unless both sides of it are blocked somewhere, or it is pinched inside."""
    line = int(fixed)
    for k in range(int(np.floor(low + TOUCH)), int(np.ceil(high - TOUCH))):
        a = grid[k, line - 1] if vertical else grid[line - 1, k]
        b = grid[k, line] if vertical else grid[line, k]
        if a and b:
            return False
    for k in range(int(np.floor(low + TOUCH)) + 1, int(np.ceil(high - TOUCH))):
        if pinched(grid, line if vertical else k, k if vertical else line):
            return False
    return True


@inner
def _touches(grid, i, j, segment, reach):
    """A piece over column i that reaches into blocked cell (i, j) stays within TOUCH of one of its upright sides, and
    the cell beyond that side is free. reach: y at both ends of the piece."""
    x0, y0, x1, y1 = segment
    low = min(max(min(reach[0], reach[1]), j + TOUCH), j + 1.0 - TOUCH)
    high = max(min(max(reach[0], reach[1]), j + 1.0 - TOUCH), j + TOUCH)
    if y1 == y0:
        return False
    a, b = x0 + (low - y0) * (x1 - x0) / (y1 - y0), x0 + (high - y0) * (x1 - x0) / (y1 - y0)
    if max(a, b) <= i + TOUCH:
        return grid[j, i - 1] == 0
    return min(a, b) >= i + 1.0 - TOUCH and grid[j, i + 1] == 0


@typed(nb.boolean(_GRID, nb.float64, nb.float64, nb.float64, nb.float64))
def segment_open(grid, x0, y0, x1, y1):
    """The segment misses the inside of every blocked cell and is not squeezed through a pinch. Ends are on the grid."""
    if x0 > x1:
        x0, y0, x1, y1 = x1, y1, x0, y0
    if x1 - x0 <= 2.0 * TOUCH and abs(x0 - np.rint(x0)) <= TOUCH:
        return _along_line_free(grid, np.rint(x0), min(y0, y1), max(y0, y1), True)
    if abs(y1 - y0) <= 2.0 * TOUCH and abs(y0 - np.rint(y0)) <= TOUCH:
        return _along_line_free(grid, np.rint(y0), x0, x1, False)
    slope = (y1 - y0) / (x1 - x0) if x1 > x0 else 0.0
    for i in range(int(np.floor(x0 + TOUCH)), int(np.ceil(x1 - TOUCH))):
        ya = y0 if i <= x0 else y0 + slope * (i - x0)
        yb = y1 if i + 1 >= x1 else y0 + slope * (i + 1 - x0)
        first, last = int(np.floor(min(ya, yb) + TOUCH)), int(np.ceil(max(ya, yb) - TOUCH))
        if last <= first and grid[first - 1, i] and grid[first, i]:
            return False  # the piece in this column lies on a grid line, blocked on both sides
        for j in range(first, last):
            if grid[j, i] and not _touches(grid, i, j, (x0, y0, x1, y1), (ya, yb)):
                return False
        corner = np.rint(yb)
        if i + 1 < x1 - TOUCH and abs(yb - corner) < TOUCH and pinched(grid, i + 1, int(corner)):
            return False
    return True


@typed(nb.boolean(_GRID, _POINTS))
def polyline_free(grid, points):
    """Every point on the grid, every segment open, and no bend in a pinch."""
    rows, columns = grid.shape
    for k in range(len(points)):
        x, y = points[k]
        if not (1.0 <= x <= columns - 1.0 and 1.0 <= y <= rows - 1.0) or not point_free(grid, x, y):
            return False
        on_corner = x == np.rint(x) and y == np.rint(y)
        if 0 < k < len(points) - 1 and on_corner and pinched(grid, int(x), int(y)):
            return False
    for k in range(len(points) - 1):
        if not segment_open(grid, points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1]):
            return False
    return True


@typed(nb.types.Tuple((_POINTS, _POINTS))(_GRID))
def convex_corners(grid):
    """(N, 2) lattice points with exactly one blocked cell round them, and (N, 2) signs of the way to that cell."""
    rows, columns = grid.shape
    count = 0
    corners = np.empty((rows * columns, 2))
    signs = np.empty((rows * columns, 2))
    for j in range(1, rows):
        for i in range(1, columns):
            sw, se, nw, ne = grid[j - 1, i - 1], grid[j - 1, i], grid[j, i - 1], grid[j, i]
            if sw + se + nw + ne == 1:
                corners[count, 0], corners[count, 1] = i, j
                signs[count, 0] = 1.0 if se or ne else -1.0
                signs[count, 1] = 1.0 if nw or ne else -1.0
                count += 1
    return corners[:count].copy(), signs[:count].copy()


@typed(nb.boolean(nb.float64, nb.float64, nb.float64, nb.float64), **INNER)
def _tangent(dx, dy, sx, sy):
    """A taut path can bend at a corner only on lines that graze its cell: not into it, nor straight away from it."""
    return (dx * sx) * (dy * sy) <= TOUCH


@typed(_POINTS(_POINTS, nb.types.Array(nb.int64, 1, "C"), nb.int64))
def _way_to(nodes, parent, last):
    """(N, 2) the nodes from the one without a parent to the last."""
    count, node = 1, last
    while parent[node] >= 0:
        node = parent[node]
        count += 1
    path = np.empty((count, 2))
    node = last
    for k in range(count - 1, -1, -1):
        path[k, 0], path[k, 1] = nodes[node, 0], nodes[node, 1]
        node = parent[node]
    return path


@typed(_POINTS(_GRID, _POINTS, _POINTS, _POINTS))
def visibility_search(grid, corners, signs, ends):
    """A* over corners with edges found when needed; (N, 2) points of the shortest path, empty if there is none.

    ends (2, 2): start, goal. A lazy search: an edge is tested for sight only if it would shorten a way and is taut
    at both its ends, which keeps the optimum and drops nearly all tests.
    """
    n = len(corners) + 2
    nodes, cost, estimate = np.empty((n, 2)), np.empty(n), np.empty(n)
    parent, closed = np.empty(n, np.int64), np.empty(n, np.uint8)
    for k in range(n):  # one number at a time: numba takes seconds over the copy of a row
        row = corners[k] if k < n - 2 else ends[k - n + 2]
        nodes[k, 0], nodes[k, 1] = row[0], row[1]
        cost[k], estimate[k], parent[k], closed[k] = np.inf, np.inf, -1, 0
    cost[n - 2] = estimate[n - 2] = 0.0
    while True:
        u = 0
        for v in range(1, n):
            if estimate[v] < estimate[u]:
                u = v
        if estimate[u] == np.inf:
            return np.empty((0, 2))
        if u == n - 1:
            return _way_to(nodes, parent, u)
        closed[u], estimate[u] = 1, np.inf
        for v in range(n):
            if closed[v]:
                continue
            dx, dy = nodes[v, 0] - nodes[u, 0], nodes[v, 1] - nodes[u, 1]
            through = cost[u] + np.sqrt(dx * dx + dy * dy)
            if through >= cost[v]:
                continue
            if u < n - 2 and not _tangent(dx, dy, signs[u, 0], signs[u, 1]):
                continue
            if v < n - 2 and not _tangent(dx, dy, signs[v, 0], signs[v, 1]):
                continue
            if segment_open(grid, nodes[u, 0], nodes[u, 1], nodes[v, 0], nodes[v, 1]):
                cost[v], parent[v] = through, u
                gx, gy = nodes[v, 0] - ends[1, 0], nodes[v, 1] - ends[1, 1]
                estimate[v] = through + np.sqrt(gx * gx + gy * gy)


@typed(nb.float64(_POINTS, _POINTS, nb.float64))
def least_gap(points, low, side):
    """Least distance between a polyline (N, 2) and squares of this side with lower corners low (M, 2) that it does not
    cross; inf without squares. It is met at an end of a segment or at a corner of a square."""
    best, last = np.inf, len(points) - 1
    for k in range(max(last, 1)):
        ax, ay = points[k]
        bx, by = points[min(k + 1, last)]
        dx, dy = bx - ax, by - ay
        length2 = dx * dx + dy * dy
        for s in range(len(low)):
            x, y = low[s]
            gap_x = max(x - max(ax, bx), min(ax, bx) - x - side, 0.0)
            gap_y = max(y - max(ay, by), min(ay, by) - y - side, 0.0)
            if np.hypot(gap_x, gap_y) >= best:
                continue  # not even the box round the segment is nearer
            for ex, ey in ((ax, ay), (bx, by)):
                best = min(best, np.hypot(max(x - ex, ex - x - side, 0.0), max(y - ey, ey - y - side, 0.0)))
            for cx, cy in ((x, y), (x + side, y), (x, y + side), (x + side, y + side)):
                t = ((cx - ax) * dx + (cy - ay) * dy) / length2 if length2 > 0.0 else 0.0
                t = min(max(t, 0.0), 1.0)
                best = min(best, np.hypot(cx - ax - t * dx, cy - ay - t * dy))
    return best
