"""Odometries compared on identical frames of a simulated survey:

    python tests/benchmarks/odometry_laps.py --seeds 10 procrustes procrustes:refine=none
    python tests/benchmarks/odometry_laps.py --world square_relief --seeds 3 kiss_icp kiss_icp:guess=wheel gicp

One run is a seed and a direction of the route round the world; the seed moves the paintings, the camera's wobble, the
sensor's noise and RANSAC's draws. Each odometry sees the same observations. Writes one row per run and odometry to
OUT/laps_WORLD_runs.csv and medians with 95 % bootstrap intervals to OUT/laps_WORLD.csv.
ATE: rigidly aligned RMSE of positions; drift: distance between the ends of estimate and truth from a common start; both
in per cent of the way. Times are CPU times of one process; features shared by two odometries are counted to the first.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from shared import odometry, write

from rhs.api.contracts import Context, FeatureSettings, SourceContext
from rhs.api.geometry import planar, wrap
from rhs.api.randomness import generator
from rhs.api.trajectory import Trajectory
from rhs.config import registry
from rhs.metrics.accuracy import absolute_errors_m, consecutive, pair, relative_errors, rmse
from rhs.worlds.world import load_world

COLUMNS = ("ate_percent", "drift_percent", "yaw_error_deg", "rpe_trans_mm", "rpe_rot_mrad", "nees_planar", "ok_share",
           "degenerate_share", "lost_share", "odometry_ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("odometries", nargs="*", default=["procrustes", "procrustes:refine=none"],
                        help="name or name:setting=value,setting=value")
    parser.add_argument("--world", default="square")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--directions", nargs="+", default=["ccw", "cw"], choices=["ccw", "cw"])
    parser.add_argument("--width", type=int, default=320, help="image width, pixels")
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        for direction in chosen.directions:
            rows += one_run(chosen.world, seed, direction, chosen.width, chosen.odometries)
            print(*(f"{k}={v}" for k, v in rows[-1].items()))
    name = f"laps_{Path(chosen.world).stem}" + (f"_{chosen.width}" if chosen.width != 320 else "")
    write(chosen.out / f"{name}_runs.csv", rows)
    write(chosen.out / f"{name}.csv", [summary(rows, word) for word in chosen.odometries])
    print((chosen.out / f"{name}.csv").read_text())


def one_run(world: str, seed: int, direction: str, width: int, words: list[str]) -> list[dict[str, Any]]:
    """One row per odometry for one survey; the observations are made once."""
    with tempfile.TemporaryDirectory() as name:
        folder, settings = Path(name), registry.load("source", "simulator")
        source = settings(direction=direction, texture_seed=seed, image_width=width).build(
            SourceContext(generator(seed, "source"), load_world(world), folder))
        context = Context(generator(seed, "sensor"), source.camera, source.facts, folder, FeatureSettings())
        sensor = registry.load("sensor", "rgbd")().build(context)
        parts = [odometry(word, replace(context, rng=generator(seed, "odometry"))) for word in words]
        followed = [Followed(part) for part in parts]
        stamps, truth = [], []
        while (capture := source.lead()) is not None:
            observation = sensor.sense(capture)
            stamps.append(capture.stamp_s)
            truth.append(source.truth())
            for one in followed:
                one.see(observation, truth[0])
        source.close()
    true = Trajectory(np.array(stamps), np.array(truth))
    about = {"world": world, "seed": seed, "direction": direction}
    return [{**about, "odometry": word, **one.row(true)} for word, one in zip(words, followed, strict=True)]


class Followed:
    """An odometry, its poses so far, its statuses and the CPU time it took."""

    def __init__(self, part: Any) -> None:
        self.part, self.poses, self.motions, self.cpu_s = part, [], [], []

    def see(self, observation: Any, start: np.ndarray) -> None:
        begin = time.process_time()
        motion = self.part.update(observation)
        self.cpu_s.append(time.process_time() - begin)
        self.poses.append(self.poses[-1] @ motion.previous_from_body if self.poses else start)
        self.motions.append(motion)

    def row(self, truth: Trajectory) -> dict[str, float | str]:
        both = pair(Trajectory(truth.stamps_s, np.array(self.poses)), truth, 1e-6)
        trans, rot = relative_errors(both, consecutive(len(truth)))
        way = truth.travelled_m[-1]
        ends = self.poses[-1], truth.poses[-1]
        statuses = [str(motion.status) for motion in self.motions[1:]]
        values = {
            "ate_percent": 100 * rmse(absolute_errors_m(both, "se3")) / way,
            "drift_percent": 100 * np.linalg.norm(ends[0][:3, 3] - ends[1][:3, 3]) / way,
            "yaw_error_deg": np.degrees(float(wrap(planar(ends[0])[2] - planar(ends[1])[2]))),
            "rpe_trans_mm": 1e3 * rmse(trans),
            "rpe_rot_mrad": 1e3 * rmse(rot),
            "nees_planar": self._nees(truth.poses),
            **{f"{word}_share": statuses.count(word) / len(statuses) for word in ("ok", "degenerate", "lost")},
            "odometry_ms": 1e3 * float(np.median(self.cpu_s)),
        }
        return {"way_m": f"{way:.3f}", **{key: f"{value:.4g}" for key, value in values.items()}}

    def _nees(self, truth: np.ndarray) -> float:
        """Mean over the views of the squared error of (x, y, yaw) in units of its covariance; 3 is calibrated."""
        squared, free = [], [0, 1, 5]
        for before, after, motion in zip(truth[:-1], truth[1:], self.motions[1:], strict=True):
            error = planar(np.linalg.inv(motion.previous_from_body) @ np.linalg.inv(before) @ after)
            squared.append(error @ np.linalg.solve(motion.covariance[np.ix_(free, free)], error))
        return float(np.mean(squared))


def summary(rows: list[dict[str, Any]], word: str) -> dict[str, Any]:
    """Median and 95 % bootstrap interval of the median over the runs, and the worst run, for one odometry."""
    mine = [row for row in rows if row["odometry"] == word]
    out: dict[str, Any] = {"odometry": word, "runs": len(mine)}
    for column in COLUMNS:
        values = np.abs([float(row[column]) for row in mine])
        draws = np.random.default_rng(0).choice(values, (2000, len(values)))
        low, high = np.percentile(np.median(draws, axis=1), [2.5, 97.5])
        out[column] = f"{np.median(values):.4g}"
        out[f"{column}_95"] = f"{low:.3g}..{high:.3g}"
        out[f"{column}_worst"] = f"{values.max():.4g}"
    return out


if __name__ == "__main__":
    main()
