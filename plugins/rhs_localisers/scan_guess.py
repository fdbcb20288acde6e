"""A guess of the pose corrected by laying the scan onto the map (rhs.estimation.scans.scan_match), where no place is
recognised."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import exp_se3, orthonormal, planar, se2
from rhs.api.records import Scan
from rhs.estimation.filters.kalman import correct_information
from rhs.estimation.filters.pose_hypotheses import PLANE, Hypothesis
from rhs.estimation.scans.scan_match import ScanMatcher


def laid_on_map(guess: Hypothesis, scan: Scan, matcher: ScanMatcher) -> Hypothesis:
    """The guess moved to where the scan fits, as far as the scan can tell; unchanged where it does not fit nearby."""
    state = planar(guess.map_from_body)
    found = matcher.match(scan, state, PLANE @ guess.covariance @ PLANE.T)
    if found is None:
        return guess
    shift = planar(np.linalg.inv(se2(*state)) @ se2(*found.state))
    pose = orthonormal(guess.map_from_body @ exp_se3(PLANE.T @ shift))
    covariance = correct_information(guess.covariance, PLANE.T @ found.information @ PLANE, np.zeros(6)).covariance
    return Hypothesis(pose, covariance, guess.weight)


def drifted(
    covariance: np.ndarray, previous_from_body: np.ndarray, per_m: float, rad_per_m: float, steady_m: float = 5.0
) -> np.ndarray:
    """The (6, 6) covariance of a motion widened by a drift that keeps its sign for steady_m of way, which the covariance
    of single motions does not say: after L metres it has grown to per_m sqrt(L steady_m)."""
    way_m = float(np.hypot(*previous_from_body[:2, 3]))
    return covariance + steady_m * way_m * np.diag([per_m**2] * 2 + [0.0] * 3 + [rad_per_m**2])
