"""Does a robot know whether it knows where it is? Kidnaps, calibration and wrong certainty, from the steps of a patrol.

A belief is right within 0.25 m and 5 degrees of the truth (rhs.belief), and sure of itself when its status is tracking.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.belief import RIGHT_M, RIGHT_RAD
from rhs.api.geometry import wrap
from rhs.api.metric import LOOP, RunFiles, columns_of

WITHIN_M = 5.0  # a kidnapped robot is judged after so much way
PHASES = ("patrol", "localise")  # in which a localiser believes
BINS = 10


@dataclass(frozen=True, eq=False)
class Beliefs:
    """Views of a patrol or of task=localise whose truth is known. stamps_s, wrong_m, wrong_rad, probability, sure,
    kidnapped, started: (N,) each; xy_m (N, 2): where the robot truly was. kidnapped: carried elsewhere since the view
    before. started: the localiser began here."""

    stamps_s: np.ndarray
    xy_m: np.ndarray
    wrong_m: np.ndarray
    wrong_rad: np.ndarray
    probability: np.ndarray
    sure: np.ndarray
    kidnapped: np.ndarray
    started: np.ndarray

    @property
    def right(self) -> np.ndarray:
        return (self.wrong_m < RIGHT_M) & (self.wrong_rad < RIGHT_RAD)


@dataclass(frozen=True, eq=False)
class Kidnap:
    """One kidnap and what followed, up to WITHIN_M of way, the next kidnap or the end. way_m, wrong_m, sure: per view.
    metres, seconds: until it first called itself tracking and was right, NaN if never. wrong_sure: at the end it called
    itself tracking and was wrong."""

    way_m: np.ndarray
    wrong_m: np.ndarray
    sure: np.ndarray
    metres: float
    seconds: float
    wrong_sure: bool


def beliefs_of(steps: Sequence[Mapping[str, str]]) -> Beliefs:
    """From rows of steps.csv; views without truth are left out."""
    rows = [row for row in steps if row["true_x_m"]]

    def column(name: str) -> np.ndarray:
        return np.array([float(row[name] or "nan") for row in rows])

    true = np.stack([column("true_x_m"), column("true_y_m")], axis=1).reshape(-1, 2)
    gap = np.stack([column("x_m"), column("y_m")], axis=1).reshape(-1, 2) - true
    return Beliefs(
        column("stamp_s"), true, np.hypot(*gap.T), np.abs(wrap(column("yaw_rad") - column("true_yaw_rad"))),
        column("belief_probability"), np.array([row["belief_status"] == "tracking" for row in rows], bool),
        *(np.array([event in row["event"].split("+") for row in rows], bool) for event in ("kidnapped", "started")),
    )  # fmt: skip


def kidnaps(beliefs: Beliefs) -> list[Kidnap]:
    """Every kidnap of a patrol, judged."""
    return searches(beliefs, beliefs.kidnapped, WITHIN_M)


def searches(beliefs: Beliefs, begins_here: np.ndarray, within_m: float) -> list[Kidnap]:
    """What followed each view (N,) bool at which the robot had to find itself, up to within_m of way or the next of them."""
    begins = np.nonzero(begins_here)[0]
    ends = np.append(begins, len(beliefs.kidnapped))[1:]
    return [_judged(beliefs, int(begin), int(end), within_m) for begin, end in zip(begins, ends, strict=True)]


def _judged(beliefs: Beliefs, begin: int, end: int, within_m: float) -> Kidnap:
    steps_m = np.linalg.norm(np.diff(beliefs.xy_m[begin:end], axis=0), axis=1)
    way_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    views = np.arange(begin, end)[way_m <= within_m]
    way_m = way_m[way_m <= within_m]
    found = np.nonzero(beliefs.sure[views] & beliefs.right[views])[0]
    metres, seconds = np.nan, np.nan
    if len(found):
        metres = float(way_m[found[0]])
        seconds = float(beliefs.stamps_s[views[found[0]]] - beliefs.stamps_s[begin])
    last = views[-1]
    wrong_sure = bool(beliefs.sure[last] and not beliefs.right[last])
    return Kidnap(way_m, beliefs.wrong_m[views], beliefs.sure[views], metres, seconds, wrong_sure)


def reliability(probability: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(B, 3) of the bins of predicted chance that hold any view: mean chance, share that was right, number of views."""
    at = np.minimum((BINS * np.asarray(probability)).astype(int), BINS - 1)
    right = np.asarray(right, float)
    return np.array([[probability[at == b].mean(), right[at == b].mean(), (at == b).sum()]
                     for b in np.unique(at)]).reshape(-1, 3)


def calibration_error(probability: np.ndarray, right: np.ndarray) -> float:
    """Expected calibration error: mean over the views of |chance - share right| of their bin; NaN without views."""
    if len(probability) == 0:
        return float("nan")
    chance, share, count = reliability(probability, right).T
    return float((np.abs(chance - share) * count).sum() / count.sum())


def calibration_values(run: RunFiles) -> dict[str, float | int | str]:
    """What followed each kidnap, and how reliable the stated chances were. NaN where nothing was kidnapped, or nobody
    knows the truth."""
    steps = [row for row in run.steps if row["phase"] in PHASES]
    beliefs = beliefs_of(steps)
    known, nan = len(beliefs.wrong_m) > 0, float("nan")
    happened = kidnaps(beliefs)
    again = recovered(happened)
    return {
        "kidnaps": len(happened) if known else nan,
        "kidnap_recovered_share": again["share"],
        "kidnap_recovery_m": again["metres"], "kidnap_recovery_p90_m": again["p90_metres"],
        "kidnap_recovery_s": again["seconds"], "kidnap_recovery_p90_s": again["p90_seconds"],
        "kidnap_wrong_sure_share": again["wrong_sure_share"],
        "belief_wrong_sure_share": float(np.mean(beliefs.sure & ~beliefs.right)) if known else nan,
        "belief_ece": calibration_error(beliefs.probability, beliefs.right),
    }


def recovered(happened: Sequence[Kidnap]) -> dict[str, float]:
    """share: of kidnaps after which the robot found itself; metres, seconds: until then, median, and p90_*: 90th percentile;
    wrong_sure_share: after which it was wrong and sure. NaN of none."""
    found, nan = [one for one in happened if np.isfinite(one.metres)], float("nan")
    out = {"share": len(found) / len(happened) if happened else nan,
           "wrong_sure_share": float(np.mean([one.wrong_sure for one in happened])) if happened else nan}
    for name in ("metres", "seconds"):
        took = [getattr(one, name) for one in found] or [nan]
        out |= {name: float(np.median(took)), f"p90_{name}": float(np.percentile(took, 90))}
    return out


CALIBRATION = columns_of(
    calibration_values,
    ("kidnaps", "", "times the robot was kidnapped: moved without being told", "steps.csv"),
    ("kidnap_recovered_share", "share",
     "kidnaps after which it was right and tracking within 5 m driven",
     "rhs.metrics.calibration"),
    ("kidnap_recovery_m", "m", "distance driven until then, median of those that recovered", "rhs.metrics.calibration"),
    ("kidnap_recovery_p90_m", "m", "the same, 90th percentile", "rhs.metrics.calibration"),
    ("kidnap_recovery_s", "s", "time until then, median of those that recovered", "rhs.metrics.calibration"),
    ("kidnap_recovery_p90_s", "s", "the same, 90th percentile", "rhs.metrics.calibration"),
    ("kidnap_wrong_sure_share", "share",
     "kidnaps after which it was tracking a wrong pose at the end of these 5 m",
     "rhs.metrics.calibration"),
    ("belief_wrong_sure_share", "share",
     "views of the patrol (or of task=localise) in which the belief was wrong (0.25 m, 5 degrees) and sure of itself",
     "rhs.metrics.calibration"),
    ("belief_ece", "", "expected calibration error of the belief's probability, ten bins; of an honest part 0.05 to 0.3 by "
     "luck in one patrol of 84 views, of which neighbours are right or wrong together", "Guo et al. 2017, section 2"),
    tasks=(*LOOP, "localise"), counts=("kidnaps",), more_is_better=("kidnap_recovered_share",),
)
