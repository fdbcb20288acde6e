"""Compiled loops of the stixels: what a column costs at each distance, and the distances that go together best.

Plane sweep (Collins, "A space-sweep approach to true multi-image matching", 1996) over columns that are floor up to a foot
and upright above it (stixels: Badino, Franke and Pfeiffer 2009), smoothed across columns by dynamic programming.
"""

from __future__ import annotations

import numpy as np

from rhs.api.jit import compiled


@compiled
def _between(grid, p, u, row):
    """Value of (B, T) between columns p and p + 1 at a row that lies inside."""
    q = int(row)
    v = row - q
    low = (1.0 - u) * grid[p, q] + u * grid[p + 1, q]
    return (1.0 - v) * low + v * ((1.0 - u) * grid[p, q + 1] + u * grid[p + 1, q + 1])


@compiled
def _floor(now, others, poses, bearings, slopes, eye_m, cap, unknown, out, compared):
    """out (B, T): how different each pixel is from the other views where it is floor; compared (B, T): 1 where one of
    them shows it."""
    beams, rows = now.shape
    per_beam, per_row = bearings[1] - bearings[0], slopes[1] - slopes[0]
    for i in range(beams):
        for j in range(rows):
            if slopes[j] >= -0.02:
                out[i, j] = cap
                continue
            far, total, count = -eye_m / slopes[j], 0.0, 0
            for k in range(len(others)):
                x, y = far * np.cos(bearings[i]) - poses[k, 0], far * np.sin(bearings[i]) - poses[k, 1]
                c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
                ahead, left = c * x + s * y, c * y - s * x
                if ahead <= 0.05:
                    continue
                column = (np.arctan2(left, ahead) - bearings[0]) / per_beam
                row = (-eye_m / np.hypot(ahead, left) - slopes[0]) / per_row
                if column < 0.0 or row < 0.0 or column >= beams - 1 or row >= rows - 1:
                    continue
                p = int(column)
                off = abs(_between(others[k], p, column - p, row) - now[i, j])
                if off == off:
                    total += min(off, cap)
                    count += 1
            out[i, j] = total / count if count else unknown
            compared[i, j] = 1.0 if count else 0.0


@compiled
def column_costs(now, others, poses, bearings, slopes, eye_m, ranges, extra, limits):
    """Cost (B, R) of each column at each of (R,) ranges, metres, ascending, and how many of its pixels were compared (B, R).

    now (B, T) float32, NaN where nothing is shown; others (K, B, T) from poses (K, 3) x, y, yaw of those cameras seen from
    this one; extra (B, T): what a pixel costs besides as floor; limits: cap, unknown (grey levels), top (height in metres
    above which nothing is compared), and what a low thing (`_over`) costs: grey levels once and per pixel, least height in
    metres, least share by which what is behind it is further away."""
    beams, rows = now.shape
    cap, unknown, top = limits[:3]
    per_beam, per_row = bearings[1] - bearings[0], slopes[1] - slopes[0]
    floor, compared = np.zeros((beams, rows)), np.zeros((beams, rows))
    _floor(now, others, poses, bearings, slopes, eye_m, cap, unknown, floor, compared)
    pairs = np.zeros((beams, len(ranges)))
    costs, total, count = np.zeros((beams, len(ranges))), np.zeros(rows), np.zeros(rows)
    upright, shared = np.zeros((len(ranges), rows)), np.zeros((len(ranges), rows))
    feet = np.zeros(len(ranges), np.int64)
    for i in range(beams):
        for z in range(len(ranges)):
            foot = min(max(int(np.ceil((-eye_m / ranges[z] - slopes[0]) / per_row)), 0), rows)
            end = min(max(int(np.floor(((top - eye_m) / ranges[z] - slopes[0]) / per_row)) + 1, foot), rows)
            feet[z] = foot
            total[:] = 0.0
            count[:] = 0.0
            for k in range(len(others)):
                x, y = ranges[z] * np.cos(bearings[i]) - poses[k, 0], ranges[z] * np.sin(bearings[i]) - poses[k, 1]
                c, s = np.cos(poses[k, 2]), np.sin(poses[k, 2])
                ahead, left = c * x + s * y, c * y - s * x
                if ahead <= 0.05:
                    continue
                column, nearer = (np.arctan2(left, ahead) - bearings[0]) / per_beam, ranges[z] / np.hypot(ahead, left)
                if column < 0.0 or column >= beams - 1:
                    continue
                p = int(column)
                for j in range(foot, end):
                    row = (slopes[j] * nearer - slopes[0]) / per_row
                    if row < 0.0 or row >= rows - 1:
                        continue
                    off = abs(_between(others[k], p, column - p, row) - now[i, j])
                    if off == off:
                        total[j] += min(off, cap)
                        count[j] += 1.0
            for j in range(rows):
                shown = now[i, j] == now[i, j]
                both = shown and j < end and count[j] > 0.0
                if j < foot:
                    upright[z, j] = floor[i, j] + extra[i, j] if shown else 0.0
                    shared[z, j] = compared[i, j] if shown else 0.0
                else:
                    upright[z, j] = (total[j] / count[j] if both else unknown) if shown else 0.0
                    shared[z, j] = 1.0 if both else 0.0
        _over(upright, shared, feet, ranges, slopes, limits[3:], costs[i], pairs[i])
    return costs, pairs


@compiled
def _over(upright, shared, feet, ranges, slopes, low, costs, pairs):
    """Costs (R,) of a column, and its pixels compared (R,): either one thing that fills it from its foot on, or a low one
    with something further away, of whatever cost is least, seen above it. upright, shared (R, T): cost and number of each
    pixel under each distance; feet (R,): their first row that is not floor."""
    many, rows = upright.shape
    once, each, least_m, further = low
    least, seen, behind = np.full(rows + 1, np.inf), np.zeros(rows + 1), many  # of what is behind, from each row on
    for z in range(many - 1, -1, -1):
        while behind > 0 and ranges[behind - 1] >= ranges[z] * (1.0 + further):
            behind -= 1
            cost, number = 0.0, 0.0
            for j in range(rows - 1, -1, -1):
                cost, number = cost + upright[behind, j], number + shared[behind, j]
                if cost < least[j]:
                    least[j], seen[j] = cost, number
        costs[z], pairs[z] = upright[z].sum(), shared[z].sum()
        cost, number = 0.0, 0.0
        for j in range(rows):
            high = j > feet[z] and (slopes[j] - slopes[feet[z]]) * ranges[z] >= least_m
            if high and cost + least[j] + once < costs[z]:
                costs[z], pairs[z] = cost + least[j] + once, number + seen[j]
            cost += upright[z, j] + (each if j >= feet[z] else 0.0)
            number += shared[z, j]


@compiled
def smoothest(costs, bend, leap):
    """(B,) index of the range of each column, of the least sum of costs (B, R) and of what lies between neighbours."""
    beams, steps = costs.shape
    best, came = np.zeros((beams, steps)), np.zeros((beams, steps), np.int64)
    best[0] = costs[0]
    for i in range(1, beams):
        least = int(np.argmin(best[i - 1]))
        for z in range(steps):
            value, source = best[i - 1, least] + leap, least
            for y in range(max(0, z - 4), min(steps, z + 5)):
                here = best[i - 1, y] + bend * abs(y - z)
                if here < value:
                    value, source = here, y
            best[i, z], came[i, z] = costs[i, z] + value, source
    out = np.zeros(beams, np.int64)
    out[-1] = np.argmin(best[-1])
    for i in range(beams - 1, 0, -1):
        out[i - 1] = came[i, out[i]]
    return out
