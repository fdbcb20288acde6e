"""By how much one sensor's stamps are late of another's: the time offset of temporal calibration.

Both tell how far the body turned from view to view; shifted by the offset between their clocks, they agree (Kelly and
Sukhatme, "A general framework for temporal calibration of multiple proprioceptive and exteroceptive sensors", ISER 2010,
who align orientations; Mair, Fleps, Suppa and Burschka, "Spatio-temporal initialization for IMU to camera registration",
ROBIO 2011, who shift turn rates). Here the offset is the one under which the absolute differences of the turns are least:
the camera of a robot has views that are wrong or lost, and turns to both sides. The clock of a truth, of bodies that
move in space, is compared by rates (rhs.metrics.truth_clock): tried here, it missed one view of latency in two of three
surveys that lost many views.
"""

from __future__ import annotations

import numpy as np

LEAST_VIEWS = 20  # with a turn of both
LEAST_TURN_RAD = 0.01  # in the mean of a view: less tells nothing of when
MOST_S, MOST_SHARE = 3.0, 0.25  # the largest offset looked for; of the way's time at most so much
STEPS = 8  # to a view, about the best whole number of views
OUTLIER_RAD = 0.1  # a difference counts no more than this
LEAST_OFFSET = 0.25  # of the time between two views
LEAST_GAIN = 0.4  # of the mean difference that the offset must explain


def time_offset_s(stamps_s: np.ndarray, seen_rad: np.ndarray, told_rad: np.ndarray) -> float:
    """How much later than told what was seen is stamped, seconds: 0 where no offset makes them agree clearly better, NaN
    where too little was turned to know.

    stamps_s: (N,), of views, rising; seen_rad, told_rad: (N,) turn from the view before to this one, NaN where it is not
    known. Of told_rad an unknown one counts as none."""
    stamps_s, seen_rad, told_rad = (np.asarray(one, float) for one in (stamps_s, seen_rad, told_rad))
    both = np.flatnonzero(np.isfinite(seen_rad) & np.isfinite(told_rad))
    both = both[both > 0]
    if len(both) < LEAST_VIEWS or np.abs(told_rad[both]).mean() < LEAST_TURN_RAD:
        return float("nan")
    usual_s = float(np.median(np.diff(stamps_s)))
    if not usual_s > 0.0:
        return float("nan")
    heading = np.cumsum(np.where(np.isfinite(told_rad), told_rad, 0.0))

    def best_of(tried_s: np.ndarray) -> tuple[float, float]:
        apart = [_apart(stamps_s, seen_rad, heading, both, offset_s) for offset_s in tried_s]
        return float(tried_s[np.argmin(apart)]), min(apart)

    most = int(min(MOST_S, MOST_SHARE * (stamps_s[-1] - stamps_s[0])) / usual_s)
    near_s, _ = best_of(usual_s * np.arange(-most, most + 1))
    found_s, apart = best_of(near_s + usual_s * np.arange(-STEPS, STEPS + 1) / STEPS)
    clear = apart < (1.0 - LEAST_GAIN) * _apart(stamps_s, seen_rad, heading, both, 0.0)
    return found_s if clear and abs(found_s) >= LEAST_OFFSET * usual_s else 0.0


def _apart(stamps_s: np.ndarray, seen_rad: np.ndarray, heading: np.ndarray, views: np.ndarray, offset_s: float) -> float:
    """Mean absolute difference of the turns if what was seen is offset_s late, radians, over the views that both know;
    OUTLIER_RAD where there are none."""
    then = np.interp(stamps_s - offset_s, stamps_s, heading)
    inside = (stamps_s[views - 1] - offset_s >= stamps_s[0]) & (stamps_s[views] - offset_s <= stamps_s[-1])
    views = views[inside]
    if not len(views):
        return OUTLIER_RAD
    return float(np.minimum(np.abs(seen_rad[views] - then[views] + then[views - 1]), OUTLIER_RAD).mean())
