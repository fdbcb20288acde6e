"""Every odometry on identical views of the simulated square: `python tests/benchmarks/odometry_square.py`.

Renders each world and seed once (as `python -m rhs world=.. seed=..` would), hands the same observations to every odometry
and writes results/tables/odometry_square.csv, one row per world, seed and odometry, and its _summary. Times are CPU times
of one thread; the features that procrustes and its unrefined form share are counted to the first of them.
Flagged: share of views whose motion is called degenerate or lost. Held: share of views in which the true surroundings
hold the robot in every direction (see `held`); flags are counted apart for views that are held and that are not.
end_pct: distance between the ends of estimate and truth, per cent of the way.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from shared import follow, write  # noqa: E402

from rhs.api.contracts import Context, FeatureSettings, SourceContext  # noqa: E402
from rhs.api.randomness import generator  # noqa: E402
from rhs.api.records import Observation, Tracking  # noqa: E402
from rhs.api.trajectory import Trajectory  # noqa: E402
from rhs.config import registry  # noqa: E402
from rhs.metrics.accuracy import absolute_errors_m, consecutive, pair, relative_errors, rmse  # noqa: E402
from rhs.worlds.world import load_world  # noqa: E402

VARIANTS: dict[str, tuple[str, dict]] = {
    "procrustes_unrefined": ("procrustes", {"refine": "none"}),
    "procrustes": ("procrustes", {}),
    "orb": ("orb", {}),
    "keyframe": ("keyframe", {}),
    "gicp": ("gicp", {}),
    "gicp_no_guess": ("gicp", {"guess": "last"}),
    "gicp_held": ("gicp", {"slipping": "guess"}),
    "kiss_icp": ("kiss_icp", {}),
    "kiss_icp_no_guess": ("kiss_icp", {"guess": "last"}),
    "kiss_icp_held": ("kiss_icp", {"slipping": "guess"}),
    "wheel": ("wheel", {}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", nargs="+", default=["square", "square_relief"])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--odometries", nargs="+", default=list(VARIANTS))
    parser.add_argument("--out", type=Path, default=Path("results/tables/odometry_square.csv"))
    chosen = parser.parse_args()
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict] = []
    for seed in range(chosen.seeds):
        for world in chosen.worlds:
            views, truth, context = record(world, seed)
            for name in chosen.odometries:
                row = measure(name, seed, views, truth, context, relief="relief" in world)
                rows.append({"world": world, "seed": seed, "odometry": name, **row})
                print(*rows[-1].values(), flush=True)
        write(chosen.out, rows)
        write(chosen.out.with_stem(chosen.out.stem + "_summary"), summary(rows))


def summary(rows: list[dict]) -> list[dict]:
    """Median over the seeds of every figure for each world and odometry, and the worst ATE and end error."""
    out = []
    for world, name in dict.fromkeys((row["world"], row["odometry"]) for row in rows):
        mine = [row for row in rows if (row["world"], row["odometry"]) == (world, name)]
        figures = [key for key in mine[0] if key not in ("world", "seed", "odometry", "views", "distance_m")]
        middle = {key: float(np.median([row[key] for row in mine])) for key in figures}
        worst = {f"{key}_worst": max(row[key] for row in mine) for key in ("ate_m", "end_pct")}
        out.append({"world": world, "odometry": name, "seeds": len(mine), **middle, **worst})
    return out


def record(world: str, seed: int) -> tuple[list[Observation], Trajectory, Context]:
    """All observations of one survey, its true trajectory, and what an odometry is built from."""
    place = SourceContext(generator(seed, "source"), load_world(world), Path())
    source = registry.load("source", "simulator")().build(place)
    features = FeatureSettings()
    context = Context(generator(seed, "sensor"), source.camera, source.facts, Path(), features)
    sensor = registry.load("sensor", "rgbd")().build(context)
    views, poses = [], []
    while (capture := source.lead()) is not None:
        views.append(sensor.sense(capture))
        poses.append(source.truth())
    source.close()
    return views, Trajectory(np.array([v.stamp_s for v in views]), np.array(poses)), context


def measure(name: str, seed: int, views: list[Observation], truth: Trajectory, context: Context, *, relief: bool) -> dict:
    """One odometry on these views: errors, flags and time."""
    kind, settings = VARIANTS[name]
    own = Context(generator(seed, "odometry"), context.camera, context.world, context.folder, context.features)
    odometry = registry.load("odometry", kind)(**settings).build(own)
    poses, motions, seconds = follow(odometry, views, truth.poses[0])
    both = pair(Trajectory(truth.stamps_s, poses), truth, 1e-6)
    steps_m, steps_rad = relative_errors(both, consecutive(len(poses)))
    distance = float(truth.travelled_m[-1])
    end = float(np.linalg.norm(poses[-1][:2, 3] - truth.poses[-1][:2, 3]))
    flags = np.array([m.status is not Tracking.OK for m in motions[1:]])  # the first view moves nothing
    is_held = np.array([held(v, t, relief) for v, t in zip(views[1:], truth.poses[1:], strict=True)])
    return {
        "views": len(views), "distance_m": distance, "ate_m": rmse(absolute_errors_m(both, "se3")),
        "completeness": len(poses) / len(truth), "rpe_m": rmse(steps_m), "rpe_rad": rmse(steps_rad),
        "end_pct": 100 * end / distance,
        "along_share": along_share(poses, truth),
        "flagged_unheld_share": float(flags[~is_held].mean()) if (~is_held).any() else np.nan,
        "flagged_held_share": float(flags[is_held].mean()) if is_held.any() else np.nan,
        "held_share": float(is_held.mean()),
        "flagged_share": float(flags.mean()), "lost_share": float(np.mean([m.status is Tracking.LOST for m in motions])),
        "cpu_ms": 1e3 * float(np.median(seconds[1:])),
    }


def along_share(poses: np.ndarray, truth: Trajectory) -> float:
    """Length of the first corridor as estimated over its true length: 1 is right, less has slid along the walls."""
    count = int(np.argmax(np.linalg.norm(truth.poses[:, :2, 3] - truth.poses[0, :2, 3], axis=1) > 12.0))
    gone = np.linalg.norm(poses[count][:2, 3] - poses[0][:2, 3])
    return float(gone / np.linalg.norm(truth.poses[count, :2, 3] - truth.poses[0, :2, 3]))


def held(view: Observation, world_from_body: np.ndarray, relief: bool) -> bool:
    """Whether the true surroundings hold the robot in every horizontal direction: there is relief, or walls of both
    directions are in sight of the camera (each is hit by at least 2 % of the beams; the walls stand at 0, 2, 18, 20 m).
    """
    if relief or view.scan is None:
        return True
    known = np.isfinite(view.scan.ranges_m)
    bearings, ranges = view.scan.bearings_rad[known], view.scan.ranges_m[known]
    local = np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings), 0 * ranges, np.ones(len(ranges))])
    ends = (world_from_body @ local)[:2]
    near = np.abs(ends[:, :, None] - np.array([0.0, 2.0, 18.0, 20.0])).min(axis=2) < 0.1 + 0.01 * ranges
    only = np.mean([near[0] & ~near[1], near[1] & ~near[0]], axis=1)  # share on walls across x, across y
    return bool(only.min() > 0.01)


if __name__ == "__main__":
    main()
