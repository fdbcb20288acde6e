"""Which stored views are best done without: those whose place another one shows as well."""

from __future__ import annotations

import numpy as np

SPACING_M, SPACING_RAD = 0.5, 0.35  # so far apart two views of one place differ about as much by way as by turning


def thinned(poses: np.ndarray, count: int) -> np.ndarray:
    """(count,) rows of (N, 4, 4) poses to give up, one after the other the later of the two nearest; never the first or the
    last. count: below N - 1."""
    centres, rotations = poses[:, :3, 3].astype(np.float32), poses[:, :3, :3].reshape(-1, 9).astype(np.float32)
    squared = (centres**2).sum(axis=1)
    apart = np.sqrt(np.maximum(squared[:, None] + squared - 2.0 * centres @ centres.T, 0.0)) / SPACING_M
    apart += np.arccos(np.clip(0.5 * (rotations @ rotations.T - 1.0), -1.0, 1.0)) / SPACING_RAD
    np.fill_diagonal(apart, np.inf)
    nearest = apart.argmin(axis=1)
    alone = apart[np.arange(len(poses)), nearest]
    alone[[0, -1]] = np.inf
    given = []
    for _ in range(count):
        k = len(alone) - 1 - int(alone[::-1].argmin())
        given.append(k)
        apart[:, k], alone[k] = np.inf, np.inf
        for row in np.flatnonzero(nearest == k):
            nearest[row] = apart[row].argmin()
            if np.isfinite(alone[row]):
                alone[row] = apart[row, nearest[row]]
    return np.array(given, int)
