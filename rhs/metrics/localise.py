"""Columns of task=localise: how soon a localiser finds itself in a given map, and whether it knows.

A belief is right within 0.25 m and 5 degrees of the truth (rhs.api.belief), and sure of itself when its status is tracking.
The truth stands in the frame of the map: the task has moved it there.
"""

from __future__ import annotations

import numpy as np

from rhs.api.metric import RunFiles, columns_of

from .accuracy import rmse
from .calibration import beliefs_of, recovered, searches
from .survey import NAN, Values, share

FOUND_WITHIN_M = 10.0  # a robot that begins anywhere is judged after so much way


def localise_values(run: RunFiles) -> Values:
    """All of them; NaN where nobody knows the truth."""
    steps = [row for row in run.steps if row["phase"] == "localise"]
    beliefs = beliefs_of(steps)
    begun = searches(beliefs, beliefs.started | beliefs.kidnapped, FOUND_WITHIN_M)
    found = recovered(begun)
    tracking = beliefs.sure
    noted = run.json("localise") or {}
    misfit = noted.get("map_misfit_m")
    return {
        "localise_steps": len(steps),
        "localise_way_m": float(np.linalg.norm(np.diff(beliefs.xy_m, axis=0), axis=1).sum()) if len(beliefs.xy_m) else NAN,
        "starts": sum(bool({"started", "kidnapped"} & set(row["event"].split("+"))) for row in steps),
        "found_share": found["share"], "found_m": found["metres"], "found_p90_m": found["p90_metres"],
        "start_wrong_sure_share": found["wrong_sure_share"],
        "belief_right_share": float(beliefs.right.mean()) if len(beliefs.right) else NAN,
        "belief_sure_share": share(steps, "belief_status", "tracking"),
        "belief_lost_share": share(steps, "belief_status", "lost"),
        "localise_rmse_m": rmse(beliefs.wrong_m[tracking]) if tracking.any() else NAN,
        "localise_rmse_rad": rmse(beliefs.wrong_rad[tracking]) if tracking.any() else NAN,
        "motion_ok_share": share(steps, "motion_status", "ok"),
        "map_misfit_m": NAN if misfit is None else float(misfit),
        "map_size_ratio": float(noted.get("map_size_ratio", NAN)),
    }


LOCALISE = columns_of(
    localise_values,
    ("localise_steps", "", "views given to the localiser", "steps.csv"),
    ("localise_way_m", "m", "true length of that drive, jumps of kidnaps included", "steps.csv, truth"),
    ("starts", "", "times the localiser had to find its pose: at a start, or kidnapped", "steps.csv"),
    ("found_share", "share", "of these, those after which it was right and tracking within 10 m driven",
     "rhs.metrics.localise"),
    ("found_m", "m", "distance driven until then, median of the successful ones", "rhs.metrics.localise"),
    ("found_p90_m", "m", "the same, 90th percentile", "rhs.metrics.localise"),
    ("start_wrong_sure_share", "share", "starts after which it was tracking a wrong pose at the end of these 10 m",
     "rhs.metrics.localise"),
    ("belief_right_share", "share", "views in which the belief was right (0.25 m, 5 degrees), sure or not",
     "steps.csv, truth"),
    ("belief_sure_share", "share", "views in which the belief claimed to track", "steps.csv"),
    ("belief_lost_share", "share", "views in which the belief was lost by its own status", "steps.csv"),
    ("localise_rmse_m", "m", "error of the believed position while tracking, root mean square", "steps.csv, truth"),
    ("localise_rmse_rad", "rad", "the same of the heading", "steps.csv, truth"),
    ("motion_ok_share", "share", "views whose motion the odometry had measured (status ok)", "steps.csv"),
    ("map_misfit_m", "m",
     "distortion of the map: the trajectory of its survey against the truth aligned with it, root mean square. The belief "
     "is judged by the truth distorted in the same way",
     "localise.json"),
    ("map_size_ratio", "",
     "how far apart the map has what the odometry has one metre apart, while tracking; 1 where it is off by less than 3 %",
     "localise.json"),
    tasks=("localise",), counts=("localise_steps", "starts"),
    more_is_better=("found_share", "belief_right_share", "motion_ok_share"),
)
