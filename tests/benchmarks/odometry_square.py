"""Every odometry on identical views of the simulated square: `python tests/benchmarks/odometry_square.py`.

Renders each world and seed once (as `python -m rhs world=.. seed=..` would), hands the same observations to every odometry
and writes results/tables/odometry_square.csv: one row per world, seed and odometry. Times are CPU times of one thread.
Flagged: share of views whose motion is called degenerate or lost. Held: share of views in which the true surroundings
hold the robot along its corridor (see `held`); flags are counted apart for views that are held and that are not.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

from rhs import registry  # noqa: E402
from rhs.accuracy import absolute_errors_m, consecutive, pair, relative_errors, rmse  # noqa: E402
from rhs.contracts import Context, FeatureSettings, SourceContext  # noqa: E402
from rhs.geometry import orthonormal  # noqa: E402
from rhs.parts import generator  # noqa: E402
from rhs.records import Observation, Tracking  # noqa: E402
from rhs.trajectory import Trajectory  # noqa: E402
from rhs.world import load_world  # noqa: E402

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
    with chosen.out.open("w", newline="") as file:
        table = None
        for world in chosen.worlds:
            for seed in range(chosen.seeds):
                views, truth, context = record(world, seed)
                for name in chosen.odometries:
                    row = {"world": world, "seed": seed, "odometry": name, **measure(name, seed, views, truth, context)}
                    table = table or csv.DictWriter(file, list(row), lineterminator="\n")
                    if file.tell() == 0:
                        table.writeheader()
                    table.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})
                    file.flush()
                    print(*row.values(), flush=True)


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


def measure(name: str, seed: int, views: list[Observation], truth: Trajectory, context: Context) -> dict:
    """One odometry on these views: errors, flags and time."""
    kind, settings = VARIANTS[name]
    own = Context(generator(seed, "odometry"), context.camera, context.world, context.folder, context.features)
    odometry = registry.load("odometry", kind)(**settings).build(own)
    pose, poses, motions, seconds = truth.poses[0], [], [], []
    for number, view in enumerate(views):
        begin = time.process_time()
        motion = odometry.update(view)
        seconds.append(time.process_time() - begin)
        pose = orthonormal(pose @ motion.previous_from_body) if number else pose
        poses.append(pose)
        motions.append(motion)
    both = pair(Trajectory(truth.stamps_s, np.array(poses)), truth, 1e-6)
    steps_m, steps_rad = relative_errors(both, consecutive(len(poses)))
    distance = float(truth.travelled_m[-1])
    end = float(np.linalg.norm(poses[-1][:2, 3] - truth.poses[-1][:2, 3]))
    flags = np.array([m.status is not Tracking.OK for m in motions])
    is_held = np.array([held(view) for view in views])
    return {
        "views": len(views), "distance_m": distance, "ate_m": rmse(absolute_errors_m(both, "se3")),
        "rpe_m": rmse(steps_m), "rpe_rad": rmse(steps_rad), "end_pct": 100 * end / distance,
        "along_share": along_share(poses, truth),
        "flagged_unheld_share": float(flags[~is_held].mean()) if (~is_held).any() else np.nan,
        "flagged_held_share": float(flags[is_held].mean()) if is_held.any() else np.nan,
        "held_share": float(is_held.mean()),
        "lost_share": float(np.mean([m.status is Tracking.LOST for m in motions])),
        "cpu_ms": 1e3 * float(np.median(seconds[1:])),
    }


def along_share(poses: list[np.ndarray], truth: Trajectory) -> float:
    """Length of the first corridor as estimated over its true length: 1 is right, less has slid along the walls."""
    count = int(np.argmax(np.linalg.norm(truth.poses[:, :2, 3] - truth.poses[0, :2, 3], axis=1) > 12.0))
    gone = np.linalg.norm(poses[count][:2, 3] - poses[0][:2, 3])
    return float(gone / np.linalg.norm(truth.poses[count, :2, 3] - truth.poses[0, :2, 3]))


def held(view: Observation) -> bool:
    """Whether a wall across the view, or relief, is within the camera's range: the middle of the depth image is known.

    In a flat corridor whose end is out of range nothing is straight ahead; a wall across is what stands there."""
    height, width = view.depth.shape
    middle = view.depth[height // 3 : 2 * height // 3, width // 2 - 8 : width // 2 + 8]
    return bool(np.isfinite(middle).mean() > 0.5)


if __name__ == "__main__":
    main()
