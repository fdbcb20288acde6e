"""Is the truth by another clock than the recording's? Then the error is that of the clock, and no estimator's.

How fast a body turns and how fast it goes do not depend on where an estimate has drifted to: the lag at which both agree
best between estimate and truth is what the clocks are apart (Kalibr begins so; Furgale, Rehder and Siegwart, IROS 2013). It
is measured where one of the two correlates so much better there that it lacks less than half as much of 1, and said where
the absolute error is less than half there as well. Nothing is corrected by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import inverse
from rhs.api.trajectory import Trajectory, aligned
from rhs.runfolder.row import number_in

from .accuracy import rmse, rotation_angles

MOST_S, STEP_S = 3.0, 0.02  # lags that are tried
MOST_SHARE = 0.25  # of the recording that a lag may be
RATE_S = 0.3  # rates are means over so long
LEAST_RATES = 20
LEAST_CORRELATION = 0.5  # of one of the rates
HALF = 0.5  # of what it lacks of 1, and of the absolute error, that may be left


@dataclass(frozen=True, eq=False)
class Rates:
    """Means of turning (rad/s) and going (m/s) about the times (N,)."""

    times_s: np.ndarray
    values: np.ndarray  # (2, N)


def truth_offset(estimate: Trajectory, truth: Trajectory, alignment: str) -> tuple[float, float]:
    """Seconds by which the stamps of the truth are later than the estimate's of the same instants, and the ATE (m, rms) with
    that taken off; 0 and NaN where the clocks agree as far as can be told, NaN twice where they cannot be compared."""
    if min(len(estimate), len(truth)) < LEAST_RATES:
        return np.nan, np.nan
    window_s = max(RATE_S, float(np.median(np.diff(estimate.stamps_s))))
    seen, true = rates(estimate, window_s), rates(truth, window_s)
    most = int(min(MOST_S, MOST_SHARE * float(np.ptp(estimate.stamps_s))) / STEP_S)
    lags = STEP_S * np.arange(-most, most + 1)
    likeness = np.array([correlations(seen, true, lag, 3.0 * window_s) for lag in lags]).reshape(-1, 2)
    both = likelihood(likeness)
    if not np.isfinite(both).any():
        return np.nan, np.nan
    found = int(np.argmax(both))
    better = 1.0 - likeness[found] < HALF * (1.0 - likeness[len(lags) // 2])
    if not (better & (likeness[found] > LEAST_CORRELATION)).any() or not _inside(both, found):
        return 0.0, np.nan
    offset_s = _between(lags, both, found)
    return offset_s, error_m(estimate, truth, offset_s, alignment, 3.0 * window_s)


def clock_fault(values: Mapping[str, object]) -> str:
    """That the truth of these figures is by another clock, and what to do; empty where it is not known to be."""
    offset_s, there_m, ate_m = (number_in(values, name) for name in ("truth_offset_s", "ate_at_offset_m", "ate_rmse_m"))
    if not (offset_s and there_m < HALF * ate_m):
        return ""
    off, mend = ("late", "subtract that from") if offset_s > 0.0 else ("early", "add that to")
    return (f"the stamps of the true poses are {abs(offset_s):.2f} s {off} beside the estimate's: the ATE of {ate_m:.3g} m "
            f"is mostly that, {there_m:.3g} m without it; {mend} the stamps of the truth (no figure is corrected)")


def _inside(values: np.ndarray, at: int) -> bool:
    """Whether the greatest value has neighbours: at an end the greatest may lie beyond."""
    return 0 < at < len(values) - 1 and bool(np.isfinite(values[at - 1 : at + 2]).all())


def _between(lags: np.ndarray, values: np.ndarray, at: int) -> float:
    """The top of the parabola through a value and its neighbours."""
    left, middle, right = values[at - 1 : at + 2]
    bend = left - 2.0 * middle + right
    return float(lags[at] + (0.5 * STEP_S * (left - right) / bend if bend < 0.0 else 0.0))


def rates(way: Trajectory, window_s: float) -> Rates:
    """How fast the body of a trajectory turns and goes."""
    last = np.searchsorted(way.stamps_s, way.stamps_s + window_s - 1e-6)
    first = np.flatnonzero(last < len(way))
    last = last[first]
    took_s = way.stamps_s[last] - way.stamps_s[first]
    near = (took_s > 0.0) & (took_s < 2.0 * window_s)
    first, last, took_s = first[near], last[near], took_s[near]
    moved = inverse(way.poses[first]) @ way.poses[last]
    values = np.stack([rotation_angles(moved[:, :3, :3]), np.linalg.norm(moved[:, :3, 3], axis=1)]) / took_s
    return Rates(0.5 * (way.stamps_s[first] + way.stamps_s[last]), values)


def correlations(seen: Rates, true: Rates, lag_s: float, most_gap_s: float) -> np.ndarray:
    """(2,) correlation coefficients of turning and going, the truth read `lag_s` later; NaN of rates that never change, and
    where too little of the estimate has a truth then."""
    if min(len(seen.times_s), len(true.times_s)) < LEAST_RATES:
        return np.full(2, np.nan)
    known = covered(true.times_s, seen.times_s + lag_s, most_gap_s)
    if known.sum() < max(LEAST_RATES, 0.5 * len(known)):
        return np.full(2, np.nan)
    out = []
    for mine, theirs in zip(seen.values[:, known], true.values, strict=True):
        other = np.interp(seen.times_s[known] + lag_s, true.times_s, theirs)
        changes = min(np.ptp(mine), np.ptp(other)) > 1e-6
        out.append(float(np.corrcoef(mine, other)[0, 1]) if changes else np.nan)
    return np.array(out)


def likelihood(correlations: np.ndarray) -> np.ndarray:
    """(L,) log-likelihood (of normal errors, but for a factor) of correlations (L, 2); minus infinity where none is."""
    known = np.isfinite(correlations)
    lacking = 1.0 - np.clip(np.where(known, correlations, 0.0), 0.0, 1.0 - 1e-9) ** 2
    return np.where(known.any(axis=1), -np.log(lacking).sum(axis=1), -np.inf)


def covered(stamps_s: np.ndarray, at_s: np.ndarray, most_gap_s: float) -> np.ndarray:
    """(N,) whether times (N,) lie between two stamps that are not too far apart."""
    after = np.searchsorted(stamps_s, at_s)
    inside = (after > 0) & (after < len(stamps_s))
    after = np.clip(after, 1, len(stamps_s) - 1)
    return inside & (stamps_s[after] - stamps_s[after - 1] <= most_gap_s)


def error_m(estimate: Trajectory, truth: Trajectory, lag_s: float, alignment: str, most_gap_s: float) -> float:
    """Absolute error (rms after alignment) where the truth is read `lag_s` later."""
    known = covered(truth.stamps_s, estimate.stamps_s + lag_s, most_gap_s)
    mine = estimate.take(np.flatnonzero(known))
    if len(mine) < LEAST_RATES:
        return np.nan
    theirs = _at(truth, mine.stamps_s + lag_s)
    return rmse(np.linalg.norm(aligned(mine, theirs, alignment).positions_m - theirs.positions_m, axis=1))


def _at(truth: Trajectory, times_s: np.ndarray) -> Trajectory:
    """The truth at times: positions between its poses, rotations of the last one."""
    before = np.clip(np.searchsorted(truth.stamps_s, times_s, side="right") - 1, 0, len(truth) - 1)
    poses = truth.poses[before].copy()
    for axis in range(3):
        poses[:, axis, 3] = np.interp(times_s, truth.stamps_s, truth.poses[:, axis, 3])
    return Trajectory(times_s, poses)
