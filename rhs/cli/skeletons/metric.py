"""A metric for rhs: a column of the row."""

from __future__ import annotations

import numpy as np

from rhs.api.metric import Metric, RunFiles


def longest_step_m(run: RunFiles) -> float:
    """Computed from the files of the run folder; NaN where nobody knows."""
    way = run.trajectory("estimate")
    if way is None or len(way.poses) < 2:
        return float("nan")
    return float(np.linalg.norm(np.diff(way.poses[:, :3, 3], axis=0), axis=1).max())


Skeleton = (
    Metric("longest_step_m", "m", "longest way believed between two views of the survey", "estimate.tum", longest_step_m),
)
