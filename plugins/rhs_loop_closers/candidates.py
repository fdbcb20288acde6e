"""Which pairs of views may show one place, and which of them are worth a check.

Pairs are ranked by VLAD likeness. The likeliest of all would be many views of the one place where the camera stood longest;
so one pair of each stretch of the way is checked first, and then what lies beside the pairs that were confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.records import View
from rhs.estimation.views.place_memory import StoredDescriptors
from rhs.estimation.views.retrieval import Vlad

from .config import PoseGraph

BLOCK = 64  # views

def possible_pairs(
    views: Sequence[View], poses: np.ndarray, way_m: np.ndarray, settings: PoseGraph, rng: np.random.Generator, *,
    solid: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) and (N,) positions of earlier and later stored views, most alike first: no neighbours, and no further apart
    than the odometry may have drifted plus what two views of one place can lie apart (solid: in space)."""
    counts = [0 if view.features is None else len(view.features.pixels) for view in views]
    at = np.flatnonzero(np.array(counts) > 1)
    if len(at) < 2:
        return np.empty(0, int), np.empty(0, int)
    likeness = _likeness(views, at, np.array(counts)[at], rng)
    way, stood = way_m[at], poses[at][:, : 3 if solid else 2, 3]
    turned = poses[at][:, :3, :3]
    found = []
    for first in range(0, len(at), BLOCK):  # of earlier views, a few at a time: all pairs of all at once are 100 MB
        rows = slice(first, first + BLOCK)
        ahead = way[None, :] - way[rows][:, None]
        gap = np.linalg.norm(stood[rows][:, None] - stood[None], axis=2)
        again = (ahead > settings.min_way_m) | looked_back(turned, np.radians(settings.min_turn_deg), rows)
        within_m = settings.advanced.apart_m + settings.max_drift_share * ahead
        earlier, later = np.nonzero(again & (ahead >= 0) & (gap < within_m))
        found.append(np.stack([earlier + first, later]))
    earlier, later = np.concatenate(found, axis=1)
    order = np.argsort(-likeness[earlier, later], kind="stable")
    return at[earlier[order]], at[later[order]]


def looked_back(rotations: np.ndarray, turn_rad: float, rows: slice = slice(None)) -> np.ndarray:
    """(R, P) bool of (P, 3, 3) attitudes in the order of time, R of them in `rows` (all): between the earlier (row) and the
    later view the camera looked away by more than `turn_rad`, and the later one looks within half of that where the earlier
    one looked."""
    first = rows.start or 0
    trace = np.einsum("iab,jab->ij", rotations[rows], rotations)
    angle = np.triu(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)), first)
    away = np.maximum.accumulate(angle, axis=1) > turn_rad
    return away & (angle < 0.5 * turn_rad) & np.triu(np.ones_like(away), 1 + first)


def progress_m(poses: np.ndarray) -> np.ndarray:
    """(N,) metres: how much has come into sight up to each of (N, 4, 4) poses; a radian of turning counts as a metre of
    way, since about as much is new in the picture."""
    step = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    trace = np.einsum("nab,nab->n", poses[:-1, :3, :3], poses[1:, :3, :3])
    return np.concatenate([[0.0], np.cumsum(step + np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))])


def spread(ends_m: np.ndarray, reach_m: float, most: int) -> np.ndarray:
    """(K,) rows of pairs, K <= most, given best first by the progress (N, 2) at their ends: those without a better one
    within `reach_m` of both."""
    chosen: list[int] = []
    hidden = np.zeros(len(ends_m), bool)
    while len(chosen) < most and not hidden.all():
        best = int(np.argmin(hidden))
        chosen.append(best)
        hidden |= _near(ends_m, ends_m[best], reach_m)
    return np.array(chosen, int)


def beside(ends_m: np.ndarray, taken: np.ndarray, hits: Sequence[int], reach_m: float, most: int) -> np.ndarray:
    """(K,) rows, K <= most, that are not taken: first those within `reach_m` of both ends of a hit, then the others,
    each best first."""
    near = np.zeros(len(ends_m), bool)
    for hit in hits:
        near |= _near(ends_m, ends_m[hit], reach_m)
    left = np.ones(len(ends_m), bool)
    left[taken] = False
    return np.concatenate([np.nonzero(left & near)[0], np.nonzero(left & ~near)[0]])[:most]


def _near(ends_m: np.ndarray, pair_m: np.ndarray, reach_m: float) -> np.ndarray:
    return (np.abs(ends_m - pair_m) < reach_m).all(axis=1)


def _likeness(views: Sequence[View], at: np.ndarray, counts: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(P, P) cosines between the VLAD vectors of the stored views at rows `at`, of so many key-points (P,), over a
    vocabulary of their own."""
    starts = np.concatenate([[0], np.cumsum(counts)])
    vectors = Vlad(StoredDescriptors(views, at, starts), starts, rng).vectors
    return vectors @ vectors.T
