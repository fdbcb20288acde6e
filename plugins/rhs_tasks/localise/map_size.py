"""Is the map as large as the building? Where a localiser tracks, its way and the odometry's are of one length.

A map whose `resolution` is off by some hundredths is followed all the same: each belief is drawn to the walls of a picture
that is too large or too small, and everybody is sure of coordinates that are wrong. The ways differ by that share.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

STRETCH_M = 2.0  # chord of the odometry; what it drifts on that, and what beliefs tremble, is a hundredth of it
LEAST_STRETCHES = 10
LEAST_OFF = 0.03
SURE_SIGMA = 5.0


def map_size_ratio(beliefs: Sequence[np.ndarray], motions: Sequence[np.ndarray], follows: Sequence[bool]) -> float:
    """How far apart the map has what the odometry has one metre apart; 1 where it is off by less than LEAST_OFF and
    SURE_SIGMA standard errors, NaN where too little was followed to say.

    beliefs: (4, 4) map_from_body of each view. motions: (4, 4) previous_from_body by the odometry. follows: whether a view
    was tracked and goes on from a tracked one: no start, no kidnap and no lost motion between."""
    ratios, begin, moved = [], 0, np.eye(4)
    for index, (motion, goes_on) in enumerate(zip(motions, follows, strict=True)):
        moved = moved @ motion
        chord_m = float(np.hypot(*moved[:2, 3]))
        if goes_on and chord_m >= STRETCH_M:
            ratios.append(float(np.hypot(*(beliefs[index] - beliefs[begin])[:2, 3])) / chord_m)
        if not goes_on or chord_m >= STRETCH_M:
            begin, moved = index, np.eye(4)
    if len(ratios) < LEAST_STRETCHES:
        return float("nan")
    middle = float(np.median(ratios))
    error = 1.48 * float(np.median(np.abs(np.array(ratios) - middle))) / np.sqrt(len(ratios))
    return middle if abs(middle - 1.0) > max(LEAST_OFF, SURE_SIGMA * error) else 1.0


def size_doubt(ratio: float, resolution_m: float) -> str:
    """What is wrong with the map's size, and what to type; empty where nothing is known to be."""
    if not np.isfinite(ratio) or ratio == 1.0:
        return ""
    return (f"the map is {ratio:.3f} times as large as what the odometry measures: the belief's coordinates are off by so "
            f"much; about resolution: {resolution_m / ratio:.2g} in its yaml (found {resolution_m:.3g}) would fit")
