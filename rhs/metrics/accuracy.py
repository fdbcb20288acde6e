"""How good a trajectory is, in the terms of the TUM benchmark and evo: ATE, RPE, drift.

Absolute trajectory error: distances of paired positions after an alignment that is always named. Relative pose error:
how wrong the motion between two poses is. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", 2012.
No error stands alone: `matched_share` and `covered_share` say how much of the truth it was measured on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rhs.api.geometry import inverse
from rhs.api.trajectory import Trajectory, aligned, associate
from rhs.runfolder.run import Run

NEES_TOLERANCE_S = 0.02  # between an estimate and the truth it is compared with


@dataclass(frozen=True, eq=False)
class Pairing:
    """Estimate and truth at the same instants (equal length), and how much of the truth that is.

    matched_share: paired poses / poses of the longer trajectory where both have one rate; covered_share: share of the
    truth's length between its first and last paired pose.
    """

    estimate: Trajectory
    truth: Trajectory
    matched_share: float
    covered_share: float


def pair(estimate: Trajectory, truth: Trajectory, tolerance_s: float) -> Pairing:
    """Poses of both at stamps at most `tolerance_s` apart. The share is of the truth's poses, or, where the truth was
    measured faster than the estimate, of as many as the estimate's rate would have given over the truth's time."""
    pairs = associate(estimate.stamps_s, truth.stamps_s, tolerance_s)
    if not len(pairs):
        nothing = np.zeros(0, int)
        return Pairing(estimate.take(nothing), truth.take(nothing), 0.0, 0.0)
    travelled = truth.travelled_m
    whole = travelled[-1]
    covered = travelled[pairs[-1, 1]] - travelled[pairs[0, 1]]
    return Pairing(estimate.take(pairs[:, 0]), truth.take(pairs[:, 1]), len(pairs) / _expected(estimate, truth),
                   float(covered / whole) if whole > 0 else 1.0)


def _expected(estimate: Trajectory, truth: Trajectory) -> float:
    if len(truth) <= len(estimate) or len(estimate) < 2:
        return float(max(len(truth), len(estimate)))
    gap_e, gap_t = np.median(np.diff(estimate.stamps_s)), np.median(np.diff(truth.stamps_s))
    return max(len(estimate), len(truth) * min(1.0, float(gap_t / gap_e)))


def absolute_errors_m(pairing: Pairing, how: str) -> np.ndarray:
    """(N,) metres between paired positions after alignment `how` (see trajectory.aligned)."""
    if not len(pairing.truth):
        return np.zeros(0)
    moved = aligned(pairing.estimate, pairing.truth, how)
    return np.linalg.norm(moved.positions_m - pairing.truth.positions_m, axis=1)


def relative_errors(pairing: Pairing, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M,) metres and (M,) radians by which the motion from pose i to pose j of each (i, j) of `pairs` is wrong."""
    i, j = pairs[:, 0], pairs[:, 1]
    estimated = inverse(pairing.estimate.poses[i]) @ pairing.estimate.poses[j]
    true = inverse(pairing.truth.poses[i]) @ pairing.truth.poses[j]
    error = inverse(true) @ estimated
    return np.linalg.norm(error[:, :3, 3], axis=1), rotation_angles(error[:, :3, :3])


def rotation_angles(rotations: np.ndarray) -> np.ndarray:
    """(N,) angles of (N, 3, 3) rotations, radians, exact also near zero and near pi."""
    skew = np.stack([rotations[:, 2, 1] - rotations[:, 1, 2], rotations[:, 0, 2] - rotations[:, 2, 0],
                     rotations[:, 1, 0] - rotations[:, 0, 1]], axis=1)
    return np.arctan2(np.linalg.norm(skew, axis=1), np.trace(rotations, axis1=1, axis2=2) - 1.0)


def consecutive(count: int) -> np.ndarray:
    """(count - 1, 2) pairs of neighbours."""
    return np.stack([np.arange(count - 1), np.arange(1, count)], axis=1) if count > 1 else np.zeros((0, 2), int)


def apart(progress: np.ndarray, delta: float) -> np.ndarray:
    """(M, 2) pairs (i, j) that follow one another: j is the first pose at least `delta` of progress after i.

    progress: (N,) metres travelled or seconds, not decreasing.
    """
    pairs, start = [], 0
    for index in range(1, len(progress)):
        if progress[index] - progress[start] >= delta - 1e-9:
            pairs.append((start, index))
            start = index
    return np.array(pairs, int).reshape(-1, 2)


def rmse(values: np.ndarray) -> float:
    """Root of the mean square, NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def nees_of(folder: Path) -> float:
    """Mean of the squared error of x and y, as believed while the views came, over its stated variance, per dimension
    (Bar-Shalom, Li and Kirubarajan 2001, section 5.4, without correlations, which steps.csv does not hold). The first poses
    are made to agree. NaN without a truth."""
    run = Run(folder)
    estimate, truth = run.trajectory("estimate"), run.trajectory("truth_survey")
    if estimate is None or truth is None or not run.steps:
        return float("nan")
    both = pair(estimate, truth, NEES_TOLERANCE_S)
    if len(both.truth) < 2:
        return float("nan")
    map_from_truth = both.estimate.poses[0] @ inverse(both.truth.poses[0])
    errors = (both.estimate.poses[:, :2, 3] - (map_from_truth @ both.truth.poses)[:, :2, 3])[1:]
    sigmas = {float(row["stamp_s"]): (float(row["sigma_x_m"]), float(row["sigma_y_m"])) for row in run.steps
              if row["phase"] == "survey" and row["sigma_x_m"]}
    known = np.array(list(sigmas))
    nearest = [int(np.argmin(np.abs(known - stamp))) for stamp in both.estimate.stamps_s[1:]]
    stated = np.array(list(sigmas.values()))[nearest]
    return float(np.mean((errors / np.maximum(stated, 1e-9)) ** 2))
