"""The truth of a recording in the frame of the belief: whoever measured it began somewhere else and held another body."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import align, inverse, orthonormal, planar, se3
from rhs.metrics.accuracy import pair
from rhs.metrics.survey import TOLERANCE_S, scale_known
from rhs.runfolder.run import Run

DIGITS = 6  # of a stamp: trajectories are written with nine, steps.csv as the view has it


def truth_in_map(run: Run) -> dict[float, np.ndarray]:
    """Stamp of a view, rounded to DIGITS -> (3,) true x, y, yaw, laid onto the survey as it was believed: positions by a
    rigid motion as for the ATE (Umeyama 1991), with a scale where the belief has none, headings by the mean turn that is
    left between the two bodies. Empty without a truth."""
    estimate, truth = run.trajectory("estimate"), run.trajectory("truth_survey")
    if estimate is None or truth is None:
        return {}
    both = pair(estimate, truth, TOLERANCE_S)
    if len(both.truth) < 3:
        return {}
    unknown = scale_known(run.steps) == 0.0
    map_from_truth, scale = align(both.truth.positions_m, both.estimate.positions_m, with_scale=unknown)
    laid = both.truth.poses.copy()
    laid[:, :3, 3] *= scale
    laid = map_from_truth @ laid
    turns = inverse(laid)[:, :3, :3] @ both.estimate.poses[:, :3, :3]
    body = orthonormal(se3(turns.mean(axis=0), np.zeros(3)))
    stamps = (round(float(stamp), DIGITS) for stamp in both.estimate.stamps_s)
    return {stamp: planar(pose @ body) for stamp, pose in zip(stamps, laid, strict=True)}
