"""Compiled parts of rhs.estimation.scans.point_map: points with normals, buckets, point-to-line steps. Loads numba.

Poses are (3,): x, y in metres, yaw in radians. Points and normals are (N, 2); a normal of zeros is an unknown one.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from rhs.api.jit import typed

_POINTS, _NUMBERS, _PLACES = nb.float64[:, ::1], nb.float64[::1], nb.int64[::1]
_PAIR = nb.types.Tuple((_POINTS, _POINTS))
_MAP = nb.types.Tuple((_POINTS, _POINTS, _PLACES, _NUMBERS))
_FIT = nb.types.Tuple((_NUMBERS, _POINTS, nb.float64))
_ALIKE = -0.3  # cosine: two normals further apart belong to the two sides of a wall
_BUCKET_M = 0.25
_SLOTS = 1 << 17
Walls = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""what `bucketed` returns"""


@typed(_PAIR(_NUMBERS, _NUMBERS, nb.float64, nb.float64, nb.float64, nb.float64))
def surface_points(ranges: np.ndarray, bearings: np.ndarray, most_m: float, span_m: float, span_steps: float,
                   flat: float) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the beams up to most_m, seen from the scanner, and their normals towards it: of the line through the
    neighbours within span_m or span_steps gaps between beams, if its variance across is < flat of that along."""
    n = len(ranges)
    x, y = ranges * np.cos(bearings), ranges * np.sin(bearings)
    points, normals, count = np.empty((n, 2)), np.zeros((n, 2)), 0
    for i in range(n):
        if not (0.0 < ranges[i] <= most_m):
            continue
        step = abs(bearings[min(i + 1, n - 1)] - bearings[max(i - 1, 0)]) / max(min(i + 1, n - 1) - max(i - 1, 0), 1)
        near = max(span_m, span_steps * step * ranges[i])
        sx, sy, sxx, sxy, syy, m = 0.0, 0.0, 0.0, 0.0, 0.0, 1
        for side in (-1, 1):
            for k in range(1, 13):
                j = i + side * k
                if j < 0 or j >= n or not (0.0 < ranges[j] <= most_m):
                    break
                dx, dy = x[j] - x[i], y[j] - y[i]
                if dx * dx + dy * dy > near * near:
                    break
                sx, sy, m = sx + dx, sy + dy, m + 1
                sxx, sxy, syy = sxx + dx * dx, sxy + dx * dy, syy + dy * dy
        points[count, 0], points[count, 1] = x[i], y[i]
        if m >= 3:
            a, b, c = sxx / m - (sx / m) ** 2, sxy / m - sx * sy / m**2, syy / m - (sy / m) ** 2
            half, apart = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
            if half - apart < flat * (half + apart):
                along = 0.5 * np.arctan2(2.0 * b, a - c)
                nx, ny = -np.sin(along), np.cos(along)
                towards = -1.0 if nx * x[i] + ny * y[i] > 0.0 else 1.0
                normals[count, 0], normals[count, 1] = towards * nx, towards * ny
        count += 1
    return points[:count].copy(), normals[:count].copy()


@typed(_PAIR(_POINTS, _POINTS, _PLACES, _POINTS, nb.float64))
def merged(points: np.ndarray, normals: np.ndarray, counts: np.ndarray, poses: np.ndarray, cell_m: float,
           ) -> tuple[np.ndarray, np.ndarray]:
    """Points with normals of clouds one after another, counts (K,) of each, seen from poses (K, 3), in one frame: means of
    the points in each cell whose normals look into one quarter, and of their normals."""
    slots = _SLOTS
    while slots > 64 and slots >= 4 * len(points):
        slots //= 2
    table = np.full(slots, -1, np.int32)
    keys = np.empty(len(points), np.int64)
    sums, turned, seen = np.zeros((len(points), 2)), np.zeros((len(points), 2)), np.zeros(len(points))
    count, last = 0, 0
    for cloud in range(len(counts)):
        first, last = last, last + counts[cloud]
        x0, y0, c, s = poses[cloud, 0], poses[cloud, 1], np.cos(poses[cloud, 2]), np.sin(poses[cloud, 2])
        for i in range(first, last):
            x, y = x0 + c * points[i, 0] - s * points[i, 1], y0 + s * points[i, 0] + c * points[i, 1]
            nx, ny = 0.0 + c * normals[i, 0] - s * normals[i, 1], 0.0 + s * normals[i, 0] + c * normals[i, 1]
            quarter = 0
            if nx != 0.0 or ny != 0.0:
                quarter = 1 + (2 if nx > 0.0 else 0) + (1 if ny > 0.0 else 0)
            ix, iy = int(np.floor(x / cell_m)), int(np.floor(y / cell_m))
            key = ((ix + 1048576) * 2097152 + (iy + 1048576)) * 8 + quarter
            slot = ((key * 0x9E3779B97F4A7C1) >> 20) & (slots - 1)
            while table[slot] >= 0 and keys[table[slot]] != key:
                slot = (slot + 1) & (slots - 1)
            at = table[slot]
            if at < 0:
                if count >= _SLOTS // 2:
                    continue
                at, table[slot], keys[count] = count, count, key
                count += 1
            sums[at, 0] += x
            sums[at, 1] += y
            turned[at, 0] += nx
            turned[at, 1] += ny
            seen[at] += 1.0
    for at in range(count):
        length = np.hypot(turned[at, 0], turned[at, 1])
        for axis in range(2):
            sums[at, axis] /= seen[at]
            turned[at, axis] = turned[at, axis] / length if length > 1e-9 else 0.0
    return sums[:count].copy(), turned[:count].copy()


@typed(_MAP(_POINTS, _POINTS))
def bucketed(points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The points in the order of their buckets, their normals, where each bucket starts, and west, south, columns, rows."""
    west, south = points[:, 0].min() - _BUCKET_M, points[:, 1].min() - _BUCKET_M
    columns = int((points[:, 0].max() - west) / _BUCKET_M) + 2
    rows = int((points[:, 1].max() - south) / _BUCKET_M) + 2
    starts = np.zeros(rows * columns + 1, np.int64)
    cell = np.empty(len(points), np.int64)
    for i in range(len(points)):
        cell[i] = int((points[i, 1] - south) / _BUCKET_M) * columns + int((points[i, 0] - west) / _BUCKET_M)
        starts[cell[i] + 1] += 1
    for k in range(rows * columns):
        starts[k + 1] += starts[k]
    free, p, n = starts.copy(), np.empty_like(points), np.empty_like(normals)
    for i in range(len(points)):
        at = free[cell[i]]
        free[cell[i]] += 1
        p[at, 0], p[at, 1], n[at, 0], n[at, 1] = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
    return p, n, starts, np.array([west, south, float(columns), float(rows)])


@typed(nb.int64(_MAP, nb.float64, nb.float64, nb.float64, nb.float64, nb.float64))
def _nearest(walls: Walls, x: float, y: float, nx: float, ny: float, reach: float) -> int:
    """Place of the nearest point of the map within reach that is not the other side of a wall; -1: none."""
    p, n, starts, frame = walls
    columns, rows = int(frame[2]), int(frame[3])
    column, row = int(np.floor((x - frame[0]) / _BUCKET_M)), int(np.floor((y - frame[1]) / _BUCKET_M))
    west, south = x - frame[0] - column * _BUCKET_M, y - frame[1] - row * _BUCKET_M
    inside = min(west, _BUCKET_M - west, south, _BUCKET_M - south) - 1e-9  # to the nearest side of its own bucket
    best, found = reach * reach, -1
    ring = 0
    while ring == 0 or (inside + (ring - 1) * _BUCKET_M) ** 2 <= best or inside + (ring - 1) * _BUCKET_M < 0.0:
        for at_row in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
            whole = at_row == row - ring or at_row == row + ring
            for side in range(1 if whole or ring == 0 else 2):
                left = max(column - ring, 0) if whole else column - ring if side == 0 else column + ring
                right = min(column + ring, columns - 1) if whole else left
                if left < 0 or right >= columns or right < left:
                    continue
                for k in range(starts[at_row * columns + left], starts[at_row * columns + right + 1]):
                    dx, dy = p[k, 0] - x, p[k, 1] - y
                    d2 = dx * dx + dy * dy
                    if (d2 < best or (d2 == best and k < found)) and n[k, 0] * nx + n[k, 1] * ny > _ALIKE:
                        best, found = d2, k
        ring += 1
    return found


@typed(nb.types.Tuple((_POINTS, _NUMBERS, nb.float64))(_POINTS, _POINTS, _MAP, _NUMBERS, nb.float64, nb.float64))
def linear(q: np.ndarray, qn: np.ndarray, walls: Walls, at: np.ndarray, reach: float, sigma: float,
           ) -> tuple[np.ndarray, np.ndarray, float]:
    """Information (3, 3) of points q with normals qn seen from `at`, its gradient (3,), and the share with a partner."""
    information, gradient, hit = np.zeros((3, 3)), np.zeros(3), 0
    c, s = np.cos(at[2]), np.sin(at[2])
    jac = np.empty(3)
    for i in range(len(q)):
        ox, oy = c * q[i, 0] - s * q[i, 1], s * q[i, 0] + c * q[i, 1]
        ux, uy = c * qn[i, 0] - s * qn[i, 1], s * qn[i, 0] + c * qn[i, 1]
        j = _nearest(walls, at[0] + ox, at[1] + oy, ux, uy, reach)
        if j < 0:
            continue
        hit += 1
        nx, ny = walls[1][j, 0], walls[1][j, 1]
        if nx == 0.0 and ny == 0.0:
            continue
        r = (at[0] + ox - walls[0][j, 0]) * nx + (at[1] + oy - walls[0][j, 1]) * ny
        w = 1.0 / (sigma * sigma * (1.0 + (r / (2.0 * sigma)) ** 2))
        jac[0], jac[1], jac[2] = nx * c + ny * s, ny * c - nx * s, ny * ox - nx * oy
        for a in range(3):
            gradient[a] -= w * r * jac[a]
            for b in range(3):
                information[a, b] += w * jac[a] * jac[b]
    return information, gradient, hit / max(len(q), 1)


@typed(_FIT(_POINTS, _POINTS, _MAP, _NUMBERS, _POINTS, _NUMBERS))
def fitted(q: np.ndarray, qn: np.ndarray, walls: Walls, start: np.ndarray, prior: np.ndarray, settings: np.ndarray,
           ) -> tuple[np.ndarray, np.ndarray, float]:
    """Pose (3,), information (3, 3) of the points alone, share with a partner: q laid onto the map from `start`, which
    `prior` (3, 3) information pulls towards. settings: first and last reach, sigma, trust, steps."""
    first, last, sigma, trust, steps = settings
    at = start.copy()
    for k in range(int(steps)):
        reach = max(last, first * 0.6**k)
        information, gradient, _ = linear(q, qn, walls, at, reach, sigma)
        dx, dy, turn = at[0] - start[0], at[1] - start[1], at[2] - start[2]
        c, s = np.cos(at[2]), np.sin(at[2])
        away = np.array([c * dx + s * dy, c * dy - s * dx, turn])
        whole = trust * information + prior + 1e-6 * np.eye(3)
        step = np.linalg.solve(whole, trust * gradient - prior @ away)
        most = max(abs(step[0]), abs(step[1]), abs(step[2]))
        if most > 0.3:
            step = step * (0.3 / most)
        c, s = np.cos(at[2]), np.sin(at[2])
        at[0] += c * step[0] - s * step[1]
        at[1] += s * step[0] + c * step[1]
        at[2] += step[2]
        if reach <= last and most < 3e-4:
            break
    information, _, share = linear(q, qn, walls, at, last, sigma)
    return at, trust * information, share


@typed(nb.int8[::1](_NUMBERS, _NUMBERS, _NUMBERS, _POINTS, _POINTS, _NUMBERS, _NUMBERS))
def judged(ranges: np.ndarray, bearings: np.ndarray, at: np.ndarray, m: np.ndarray, mn: np.ndarray, m_at: np.ndarray,
           limits: np.ndarray) -> np.ndarray:
    """Of each point what the beams say: -1 they pass by it, 1 they meet it, 0 nothing. limits: how far points are looked at,
    what a beam must pass by, least cosine between a normal and the way to the scanner."""
    out, n = np.zeros(len(m), np.int8), len(ranges)
    far, clear, cosine = limits[0], limits[1], limits[2]
    if n < 3:
        return out
    step = (bearings[n - 1] - bearings[0]) / (n - 1)
    c, s = np.cos(m_at[2]), np.sin(m_at[2])
    for i in range(len(m)):
        dx = at[0] - (m_at[0] + c * m[i, 0] - s * m[i, 1])
        dy = at[1] - (m_at[1] + s * m[i, 0] + c * m[i, 1])
        facing = (c * mn[i, 0] - s * mn[i, 1]) * dx + (s * mn[i, 0] + c * mn[i, 1]) * dy
        if facing < 0.0 and cosine >= 0.0:
            continue
        distance = np.hypot(dx, dy)
        if distance > far or distance < 0.1 or facing < cosine * distance:
            continue
        bearing = np.arctan2(-dy, -dx) - at[2]
        bearing -= 2.0 * np.pi * np.floor((bearing + np.pi) / (2.0 * np.pi))
        k = int(np.rint((bearing - bearings[0]) / step))
        if k < 1 or k >= n - 1:
            continue
        low, high = min(ranges[k - 1], ranges[k], ranges[k + 1]), max(ranges[k - 1], ranges[k], ranges[k + 1])
        if not (low > 0.0 and high > 0.0):  # unknown
            continue
        if low > distance + clear:
            out[i] = -1
        elif low - clear <= distance <= high + clear:
            out[i] = 1
    return out


@typed(nb.types.UniTuple(nb.int64, 2)(_NUMBERS, _NUMBERS, _NUMBERS, _POINTS, _POINTS, _NUMBERS, nb.float64, nb.float64))
def looked_through(ranges: np.ndarray, bearings: np.ndarray, at: np.ndarray, m: np.ndarray, mn: np.ndarray,
                   m_at: np.ndarray, far: float, clear: float) -> tuple[int, int]:
    """How many points m (normals mn, both seen from m_at) that face a scanner at `at` its beams pass by more than `clear`,
    and how many they meet. ranges: inf where nothing was hit; bearings ascend in even steps."""
    through, met = 0, 0
    for verdict in judged(ranges, bearings, at, m, mn, m_at, np.array([far, clear, 0.35])):
        through += verdict < 0
        met += verdict > 0
    return through, met


@typed(nb.boolean[::1](_NUMBERS, _NUMBERS, _NUMBERS, _POINTS, _NUMBERS, _NUMBERS))
def passed_by(ranges: np.ndarray, bearings: np.ndarray, at: np.ndarray, m: np.ndarray, m_at: np.ndarray,
              limits: np.ndarray) -> np.ndarray:
    """Of each point m seen from m_at whether the beams of a scanner at `at` pass by it, even where the pose between the two
    is wrong by as much as limits say: how far points are looked at, what a beam must pass by, metres and radians wrong."""
    out, n = np.zeros(len(m), np.bool_), len(ranges)
    far, clear, slack_m, slack_rad = limits
    if n < 3:
        return out
    step = (bearings[n - 1] - bearings[0]) / (n - 1)
    c, s = np.cos(m_at[2]), np.sin(m_at[2])
    for i in range(len(m)):
        dx, dy = m_at[0] + c * m[i, 0] - s * m[i, 1] - at[0], m_at[1] + s * m[i, 0] + c * m[i, 1] - at[1]
        distance = np.hypot(dx, dy)
        if distance > far or distance < 0.3:
            continue
        bearing = np.arctan2(dy, dx) - at[2]
        bearing -= 2.0 * np.pi * np.floor((bearing + np.pi) / (2.0 * np.pi))
        middle, half = (bearing - bearings[0]) / step, (slack_m / distance + slack_rad) / step
        first = min(int(np.floor(middle - half)), int(np.rint(middle)) - 1)
        last = max(int(np.ceil(middle + half)), int(np.rint(middle)) + 1)
        if first < 0 or last >= n:
            continue
        passed = True
        for k in range(first, last + 1):
            if not ranges[k] > distance + clear + slack_m:
                passed = False
                break
        out[i] = passed
    return out
