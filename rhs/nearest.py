"""Counting ratio-test matches per stored view. Loads numba: import it when it is needed."""

from __future__ import annotations

import numpy as np

from .jit import compiled


@compiled
def count_matches(likeness, bounds, ratio_squared):
    """(P,) rows of `likeness` (N, M), cosines of unit vectors, whose best column in bounds[p]:bounds[p + 1] passes
    Lowe's ratio test against the second best there; |a - b|^2 = 2 - 2 cos, so the test is on 1 - cos."""
    views = len(bounds) - 1
    counts = np.zeros(views)
    for row in range(likeness.shape[0]):
        for view in range(views):
            first, second = -2.0, -2.0
            for column in range(bounds[view], bounds[view + 1]):
                value = likeness[row, column]
                if value > first:
                    first, second = value, first
                elif value > second:
                    second = value
            if second > -2.0 and 1.0 - first < ratio_squared * (1.0 - second):
                counts[view] += 1.0
    return counts
