"""Is a map as right as its loop closer says? Surveys of drawn buildings by several odometries: error of the closed poses
against their stated covariances.

    python tests/benchmarks/sure_of_maps.py [--seeds 5101-5102] [--odometry keyframe,orb] [WORD ...]

One line per survey as it ends, then one per odometry: ATE of the closed views (median, worst, metres) and NEES over its
three dimensions (x, y, heading; mean of a survey's views): 1 is honest, 10 means stated deviations a third of the true ones.
WORDs are of the runs, `source.image_width=160` unless said. Six families a seed.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

from rhs.base.processes import steady

os.environ |= steady()

import numpy as np

from rhs.api.geometry import planar, wrap
from rhs.config.compose import compose_config
from rhs.patrol.job import lead_survey
from rhs.patrol.observers import unwatched
from rhs.patrol.run import RunContext

FAMILIES = ("loop", "ladder", "office", "home", "hall", "non_manhattan")
ODOMETRIES = "keyframe,procrustes,orb,gicp,kiss_icp,wheel"
FLAT = np.ix_([0, 1, 5], [0, 1, 5])  # of a covariance in space


def surveyed(words: list[str]) -> tuple[float, float, int]:
    """ATE in metres, NEES over three, accepted loops of one survey."""
    with tempfile.TemporaryDirectory() as home:
        config = compose_config([*words, "task=survey", "recording=off", "pictures=off", "ahead=off"])
        context = RunContext(config, Path(home), unwatched)
        job = config.task.settings.build(context)
        going, true = lead_survey(job.parts, context, job.settings, context.open_log(job.parts, job.world)), []
        try:
            while True:
                true.append(planar(next(going).truth))
        except StopIteration as end:
            closure = end.value.closure
        context.close("ok", "")
    off = np.array([planar(pose) for pose in closure.poses]) - true
    off[:, 2] = wrap(off[:, 2])
    nees = [nees_of(closure.poses[k], off[k], closure.covariances[k]) for k in range(1, len(off))
            if closure.covariances is not None and np.isfinite(closure.covariances[k, 0, 0])]
    return float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean())), float(np.mean(nees)), sum(e.accepted for e in closure.edges)


def nees_of(pose: np.ndarray, off: np.ndarray, covariance: np.ndarray) -> float:
    """Of a planar error in the map's frame (x, y, yaw), over its three dimensions; covariance (6, 6): in the body frame."""
    error = np.array([*(pose[:2, :2].T @ off[:2]), off[2]])
    return float(error @ np.linalg.solve(covariance[FLAT], error) / 3.0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="5101-5102")
    parser.add_argument("--odometry", default=ODOMETRIES)
    parser.add_argument("words", nargs="*")
    given = parser.parse_args()
    first, _, last = given.seeds.partition("-")
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(int(first), int(last or first) + 1):
        for family in FAMILIES:
            for name in given.odometry.split(","):
                words = [f"world=random:{family}", f"seed={seed}", f"odometry={name}",
                         *(given.words or ["source.image_width=160"])]
                ate_m, nees, loops = surveyed(words)
                found.setdefault(name, []).append((ate_m, nees))
                print(f"{family}/{seed} {name}: ATE {ate_m:.3f} m, NEES {nees:.2f}, {loops} loops", flush=True)
    print("\nodometry      n  ATE m, median, worst   NEES, median, worst")
    for name, rows in found.items():
        ate_m, nees = np.array(rows).T
        print(f"{name:12s} {len(rows):2d}  {np.median(ate_m):.3f}, {ate_m.max():.3f}   {np.nanmedian(nees):.2f}, "
              f"{np.nanmax(nees):.2f}")


if __name__ == "__main__":
    main()
