"""Which loop edges can be true together? Pairwise consistency through the odometry, and the largest agreeing set.

Two edges (i, j) and (k, l) make a cycle: over the first loop, along the odometry from j to l, back over the second loop,
along the odometry from k to i. It must come out at the identity, up to what the odometry may have drifted on these two
ways. Source: Mangelson, Dominic, Eustice, Vasudevan, Pairwise Consistent Measurement Set Maximization (ICRA 2018);
deviation: the bound is a drift per metre instead of a covariance, because the drift of visual odometry is steady, not
white, and the set is grown greedily from the edge with most support.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.geometry import adjoint, inverse, log_so3, planar, wrap
from rhs.api.records import LoopEdge
from rhs.estimation.filters.pose_graph import adjoints

from .settings import DriftBounds


def consistent(a: LoopEdge, b: LoopEdge, poses: np.ndarray, travelled_m: np.ndarray, bounds: DriftBounds, *,
               solid: bool = False) -> bool:
    """Whether both edges can be true, given believed poses (N, 4, 4) and metres travelled (N,) up to each; solid: in all six
    degrees of freedom, not only on the floor."""
    after = inverse(poses[a.later]) @ poses[b.later]
    before = inverse(poses[b.earlier]) @ poses[a.earlier]
    cycle = a.earlier_from_later @ after @ inverse(b.earlier_from_later) @ before
    way_m = abs(travelled_m[a.later] - travelled_m[b.later]) + abs(travelled_m[a.earlier] - travelled_m[b.earlier])
    x_m, y_m, yaw_rad = planar(cycle)
    turn_bound, axes = bounds.base_rad + bounds.rad_per_m * way_m, 3 if solid else 2
    lever_m = sum(np.linalg.norm(leg[:axes, 3]) for leg in (after, before, b.earlier_from_later))
    reach_m = bounds.base_m + bounds.per_m * way_m + turn_bound * lever_m
    off_m = float(np.linalg.norm(cycle[:3, 3])) if solid else np.hypot(x_m, y_m)
    turned = float(np.linalg.norm(log_so3(cycle[:3, :3]))) if solid else abs(wrap(yaw_rad))
    return bool(off_m <= reach_m and turned <= turn_bound)


def surprise(edges: Sequence[LoopEdge], poses: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """(M,) how far each edge moves its later view on the floor from where believed poses (N, 4, 4) put it: squared, in
    sigmas of the edge and of the motions between, covariances (N - 1, 6, 6); chi-square with 3 degrees of freedom if all
    are honest (individual compatibility; Neira and Tardos, IEEE Trans. Robotics and Automation 17(6), 2001)."""
    carried = adjoints(poses[1:])
    drifted = np.concatenate([np.zeros((1, 6, 6)), np.cumsum(carried @ motions @ np.swapaxes(carried, 1, 2), axis=0)])
    out, floor = np.empty(len(edges)), np.ix_([0, 1, 5], [0, 1, 5])
    for n, edge in enumerate(edges):
        here = adjoint(inverse(poses[edge.later]))
        spread = here @ (drifted[edge.later] - drifted[edge.earlier]) @ here.T + edge.covariance
        gap = planar(inverse(poses[edge.later]) @ poses[edge.earlier] @ edge.earlier_from_later)
        out[n] = gap @ np.linalg.solve(spread[floor], gap)
    return out


def agreement(
    edges: Sequence[LoopEdge], poses: np.ndarray, travelled_m: np.ndarray, bounds: DriftBounds, *, solid: bool = False
) -> np.ndarray:
    """(M, M) bool, symmetric, True on the diagonal: which edges can be true together."""
    out = np.eye(len(edges), dtype=bool)
    for i in range(len(edges)):
        for j in range(i):
            out[i, j] = out[j, i] = consistent(edges[i], edges[j], poses, travelled_m, bounds, solid=solid)
    return out


def largest_agreeing(agree: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Indices of a heavy set of edges that all agree with one another, by greedy growth from each edge in turn."""
    best: list[int] = []
    best_weight = -1.0
    for seed in np.argsort(-(agree @ weights), kind="stable"):
        allowed = agree[seed].copy()
        chosen: list[int] = []
        while allowed.any():
            gain = np.where(allowed, (agree & allowed) @ weights, -1.0)
            pick = int(seed) if not chosen else int(gain.argmax())
            chosen.append(pick)
            allowed &= agree[pick]
            allowed[pick] = False
        if weights[chosen].sum() > best_weight + 1e-12:
            best, best_weight = chosen, float(weights[chosen].sum())
    return np.array(sorted(best), int)


def supported(edges: Sequence[LoopEdge], travelled_m: np.ndarray, window_m: float) -> np.ndarray:
    """(M,) number of different later views, within window_m of way, whose edges lead to the same stretch of the past.

    A single look-alike view is seldom followed by others that look alike in the same order at the same distances."""
    out = np.zeros(len(edges), int)
    for i, a in enumerate(edges):
        near = {
            b.later
            for b in edges
            if abs(travelled_m[a.later] - travelled_m[b.later]) <= window_m
            and abs(travelled_m[a.earlier] - travelled_m[b.earlier]) <= 2.0 * window_m
        }
        out[i] = len(near)
    return out
