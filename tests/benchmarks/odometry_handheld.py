"""Odometries on a camera in somebody's hand: `python tests/benchmarks/odometry_handheld.py --seeds 6`.

The camera sways in six degrees of freedom in the living room of the world `home`, looks all round it twice and comes
back to where it began: 30 views a second for 20 s, about 0.2 m/s and 36 degrees a second. Kinect noise; no blur, no
rolling shutter. Every odometry sees the same views. ATE after SE(3) alignment, RPE per view;
end: distance between the ends of estimate and truth.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from odometry_square import VARIANTS  # noqa: E402
from shared import follow, write  # noqa: E402

from rhs.api.contracts import Context, FeatureSettings  # noqa: E402
from rhs.api.geometry import Camera, exp_so3, se3  # noqa: E402
from rhs.api.randomness import generator  # noqa: E402
from rhs.api.records import Capture, Observation, Tracking  # noqa: E402
from rhs.api.trajectory import Trajectory  # noqa: E402
from rhs.config import registry  # noqa: E402
from rhs.metrics.accuracy import absolute_errors_m, consecutive, pair, relative_errors, rmse  # noqa: E402
from rhs.worlds.world import load_world  # noqa: E402

RATE_HZ, SECONDS = 30.0, 20.0
CENTRE_M, REACH_M = np.array([3.1, 1.9, 1.3]), np.array([0.7, 0.5, 0.25])  # of the hand, in the room
TILT_DEG = 8.0
WAVES = 3  # slow sways that are added up in each direction, up to WAVES turns in SECONDS
SHOWN = ("procrustes_unrefined", "procrustes", "orb", "keyframe", "gicp_no_guess", "kiss_icp_no_guess")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--odometries", nargs="+", default=list(SHOWN), choices=list(VARIANTS))
    parser.add_argument("--out", type=Path, default=Path("results/tables/odometry_handheld.csv"))
    chosen = parser.parse_args()
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict] = []
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        views, truth, context = record(seed, chosen.width)
        for name in chosen.odometries:
            rows.append({"seed": seed, "odometry": name, **measure(name, seed, views, truth, context)})
            print(*(f"{v:.4g}" if isinstance(v, float) else v for v in rows[-1].values()), flush=True)
        write(chosen.out, rows)


def sway(rng: np.random.Generator, t: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(T, 3) smooth closed curve within `reach` of zero at times t in 0..1, zero at both ends."""
    out = np.zeros((len(t), 3))
    for turns in range(1, WAVES + 1):
        out += rng.uniform(-1, 1, 3) * np.sin(2 * np.pi * turns * t)[:, None] / turns
        out += rng.uniform(-1, 1, 3) * (1 - np.cos(2 * np.pi * turns * t))[:, None] / (2 * turns)
    return reach * out / max(1.0, np.abs(out).max())


def held(seed: int) -> Trajectory:
    """Poses world_from_body (x ahead, z up) of the hand: all round twice, tilting and straying."""
    rng = generator(seed, "hand")
    count = int(SECONDS * RATE_HZ)
    t = np.linspace(0.0, 1.0, count)
    place = CENTRE_M + sway(rng, t, REACH_M)
    yaw = rng.uniform(0, 2 * np.pi) + rng.choice([-1, 1]) * 4 * np.pi * t + sway(rng, t, np.full(3, 0.5))[:, 0]
    tilt = sway(rng, t, np.full(3, np.radians(TILT_DEG)))
    poses = [se3(exp_so3(np.array([0, 0, y])) @ exp_so3(np.array([a, b, 0.0])), p)
             for y, (a, b, _), p in zip(yaw, tilt, place, strict=True)]
    return Trajectory(np.arange(count) / RATE_HZ, np.array(poses))


def record(seed: int, width: int) -> tuple[list[Observation], Trajectory, Context]:
    """What a Kinect in this hand sees, its true trajectory, and what an odometry is built from."""
    truth = held(seed)
    f = 525.0 * width / 640
    camera = Camera(width, width * 3 // 4, f, f, (width - 1) / 2, (width * 3 // 4 - 1) / 2)
    world = replace(load_world("home"), seed=seed + 1)
    context = Context(generator(seed, "sensor"), camera, world.facts(), Path(), FeatureSettings())
    sensor = registry.load("sensor", "rgbd")().build(context)
    return [sensor.sense(capture) for capture in captures(world, camera, truth)], truth, context


def captures(world, camera: Camera, truth: Trajectory) -> Iterator[Capture]:
    import tempfile

    from rhs_sources.simulator_bullet_scene import BulletScene
    from rhs_sources.simulator_scene import Look

    with tempfile.TemporaryDirectory() as folder:
        scene = BulletScene(world, camera, Look(150.0, "tinyrenderer", 0, Path(folder)))  # as its table was made
        for index, (stamp, pose) in enumerate(zip(truth.stamps_s, truth.poses, strict=True)):
            image, depth = scene.render(pose)
            yield Capture(index, float(stamp), image, depth)
        scene.close()


def measure(name: str, seed: int, views: list[Observation], truth: Trajectory, context: Context) -> dict:
    """One odometry on these views."""
    kind, settings = VARIANTS[name]
    odometry = registry.load("odometry", kind)(**settings).build(replace(context, rng=generator(seed, "odometry")))
    poses, motions, seconds = follow(odometry, views, truth.poses[0])
    statuses = [motion.status for motion in motions]
    both = pair(Trajectory(truth.stamps_s, poses), truth, 1e-6)
    steps_m, steps_rad = relative_errors(both, consecutive(len(poses)))
    return {"views": len(views), "way_m": float(truth.travelled_m[-1]), "ate_m": rmse(absolute_errors_m(both, "se3")),
            "rpe_m": rmse(steps_m), "rpe_rad": rmse(steps_rad),
            "end_m": float(np.linalg.norm(poses[-1][:3, 3] - truth.poses[-1][:3, 3])),
            **{f"{word}_share": float(np.mean([status is word for status in statuses]))
               for word in (Tracking.DEGENERATE, Tracking.LOST)},
            "cpu_ms": 1e3 * float(np.median(seconds[1:]))}


if __name__ == "__main__":
    main()
