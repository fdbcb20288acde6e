"""What `odometry=keyframe` holds over a drive without end: `python tests/benchmarks/keyframe_memory.py --views 20000`.

One survey of a world is led once and kept in a folder; then its views are shown again lap after lap, each lap with a
sensor's fresh noise, to one odometry in this process. Every thousand views a row: key frames held and made, points, edges,
memory of the process (VmRSS), CPU time of the odometry per view since the last row, and the ATE of the settled poses of
the whole way (SE(3) alignment). Writes results/tables/keyframe_memory.csv.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from shared import write  # noqa: E402

from rhs.api.contracts import Context, FeatureSettings, SourceContext  # noqa: E402
from rhs.api.geometry import Camera  # noqa: E402
from rhs.api.randomness import generator  # noqa: E402
from rhs.api.records import Capture, Tracking  # noqa: E402
from rhs.api.trajectory import Trajectory  # noqa: E402
from rhs.config import registry  # noqa: E402
from rhs.metrics.accuracy import absolute_errors_m, pair, rmse  # noqa: E402
from rhs.worlds.world import load_world  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--world", default="square")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--views", type=int, default=20000)
    parser.add_argument("--every", type=int, default=1000)
    parser.add_argument("--coarse", type=int, default=1, help="every how many pixels of the pictures: a cheaper drive")
    parser.add_argument("--points", type=int, default=0, help="points followed; 0: as the odometry has it")
    parser.add_argument("--held", type=int, default=0, help="key frames held; 0: as the odometry has it")
    parser.add_argument("--kept", type=Path, help="folder of the lap; led into it when it is not there")
    parser.add_argument("--out", type=Path, default=Path("results/tables/keyframe_memory.csv"))
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = chosen.kept or Path(name) / "lap"
        if not folder.is_dir():  # in a process of its own: the renderer's memory is not the odometry's
            child = get_context("spawn").Process(target=lead, args=(folder, chosen.world, chosen.seed))
            child.start()
            child.join()
        rows = []
        for row in drive(folder, chosen):
            rows.append(row)
            print(*(f"{v:.4g}" if isinstance(v, float) else v for v in row.values()), flush=True)
    write(chosen.out, rows)


def lead(folder: Path, world: str, seed: int) -> None:
    """One survey as a camera without noise sees it, a file per view."""
    folder.mkdir(parents=True)
    place = SourceContext(generator(seed, "source"), load_world(world), Path())
    source = registry.load("source", "simulator")().build(place)
    while (seen := source.lead()) is not None:
        c = source.camera
        np.savez(folder / f"{seen.index:05d}.npz", image=seen.image, depth=seen.depth, pose=source.truth(),
                 stamp=seen.stamp_s, camera=np.array([c.fx, c.fy, c.cx, c.cy]), mount=c.body_from_camera)
    source.close()


def drive(folder: Path, chosen):
    """Rows of an odometry that is shown the lap again and again."""
    files = sorted(folder.glob("*.npz"))
    first = np.load(files[0])
    thin = slice(None, None, chosen.coarse)
    height, width = first["depth"][thin, thin].shape
    camera = Camera(width, height, *(first["camera"] / chosen.coarse).tolist(), body_from_camera=first["mount"])
    facts = load_world(chosen.world).facts()
    sensing = Context(generator(0, "sensor"), camera, facts, Path(), FeatureSettings())
    sensor = registry.load("sensor", "rgbd")().build(sensing)
    settings = registry.load("odometry", "keyframe")()
    if chosen.held:
        settings.advanced.held = chosen.held
    settings.points = chosen.points or settings.points
    odometry = settings.build(
        Context(generator(0, "odometry"), camera, facts, Path(), FeatureSettings()))
    truth, seconds, lost, lap_s = [], [], 0, float(np.load(files[-1])["stamp"]) + 0.4
    for number in range(chosen.views):
        lap, at = divmod(number, len(files))
        with np.load(files[at]) as seen:
            image, depth = seen["image"][thin, thin], seen["depth"][thin, thin]
            capture = Capture(number, lap * lap_s + float(seen["stamp"]), image, depth)
            truth.append(seen["pose"][:3].astype(np.float32))
        view = sensor.sense(capture)
        begin = time.process_time()
        motion = odometry.update(view)
        seconds.append(time.process_time() - begin)
        lost += motion.status is Tracking.LOST
        if (number + 1) % chosen.every == 0:
            ours, memory_mb = odometry._map, rss_mb()
            yield {"views": number + 1, "held": len(ours.poses), "made": ours.made, "points": len(ours.anchor),
                   "edges": len(ours.edges), "memory_mb": memory_mb, "lost_views": lost,
                   "cpu_ms": 1e3 * float(np.mean(seconds[-chosen.every:])), "ate_m": ate_m(odometry, np.array(truth))}


def ate_m(odometry, upper: np.ndarray) -> float:
    """Of the settled poses against the true ones (N, 3, 4)."""
    settled, truth = odometry.revise().poses, np.tile(np.eye(4), (len(upper), 1, 1))
    truth[:, :3] = upper
    stamps = np.arange(len(truth), dtype=float)
    return rmse(absolute_errors_m(pair(Trajectory(stamps, settled), Trajectory(stamps, truth), 1e-6), "se3"))


def rss_mb() -> float:
    """Memory of this process now, megabytes (Linux)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))


if __name__ == "__main__":
    main()
