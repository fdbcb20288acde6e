"""Every visual odometry on the real recordings: `python tests/benchmarks/odometry_recordings.py`.

Reads the folders of RHS_DATA (else ../shared/data), skips what is absent, and writes results/tables/odometry_recordings.csv.
ATE after SE(3) alignment, RPE per pair. Per view: cpu_ms is the CPU time of the odometry's own thread, without reading;
wait_ms how long the loop waits for a view, which is read ahead while the odometry works; read_ms the CPU time of
reading and decoding it, all threads. The first two are medians.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from shared import write  # noqa: E402

from rhs.api.contracts import Context, FeatureSettings, SourceContext  # noqa: E402
from rhs.api.geometry import orthonormal  # noqa: E402
from rhs.api.randomness import generator  # noqa: E402
from rhs.api.records import Tracking  # noqa: E402
from rhs.api.trajectory import Trajectory  # noqa: E402
from rhs.config import registry  # noqa: E402
from rhs.metrics.accuracy import absolute_errors_m, consecutive, pair, relative_errors, rmse  # noqa: E402

ROOT = Path(os.environ.get("RHS_DATA", Path(__file__).resolve().parents[3] / "shared" / "data")) / "rgbd"
RECORDINGS = {
    "tum_fr1_rpy_60": {"camera": "tum_fr1"},
    "open3d_5": {"camera": "primesense", "depth_scale": 1000.0},
}
VARIANTS = {
    "procrustes_unrefined": ("procrustes", {"refine": "none"}),
    "procrustes": ("procrustes", {}),
    "orb": ("orb", {}),
    "keyframe": ("keyframe", {}),
    "gicp": ("gicp", {}),
    "gicp_thinned": ("gicp", {"stride_px": 8}),
    "kiss_icp": ("kiss_icp", {"voxel_m": 0.05}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/tables/odometry_recordings.csv"))
    parser.add_argument("--odometries", nargs="+", default=list(VARIANTS), choices=list(VARIANTS))
    chosen = parser.parse_args()
    rows = []
    for recording, settings in RECORDINGS.items():
        if not (ROOT / recording).is_dir():
            print(f"{recording}: absent from {ROOT}, skipped")
            continue
        for name in chosen.odometries:
            rows.append({"recording": recording, "odometry": name, **measure(ROOT / recording, settings, name)})
            print(*rows[-1].values(), flush=True)
    write(chosen.out, rows)


def measure(folder: Path, settings: dict, name: str) -> dict:
    """One odometry on one recording."""
    place = SourceContext(generator(0, "source"), None, Path(tempfile.gettempdir()))
    source = registry.load("source", "replay")(path=str(folder), **settings).build(place)
    sensing = Context(generator(0, "sensor"), source.camera, source.facts, Path(), FeatureSettings())
    sensor = registry.load("sensor", "rgbd")().build(sensing)
    kind, own = VARIANTS[name]
    context = Context(generator(0, "odometry"), source.camera, source.facts, Path(), FeatureSettings())
    odometry = registry.load("odometry", kind)(**own).build(context)
    pose, poses, truth, stamps, flags, cpu = np.eye(4), [], [], [], [], []
    waited = []
    while True:
        begin = time.perf_counter()
        capture = source.lead()
        waited.append(time.perf_counter() - begin)
        if capture is None:
            break
        view = sensor.sense(capture)
        begin = time.thread_time()
        motion = odometry.update(view)
        cpu.append(time.thread_time() - begin)
        pose = orthonormal(pose @ motion.previous_from_body)
        poses.append(pose)
        truth.append(source.truth())
        stamps.append(capture.stamp_s)
        flags.append(motion.status is Tracking.LOST)
    source.close()
    both = pair(Trajectory(np.array(stamps), np.array(poses)), Trajectory(np.array(stamps), np.array(truth)), 1e-6)
    steps_m, steps_rad = relative_errors(both, consecutive(len(poses)))
    return {
        "views": len(poses), "ate_m": rmse(absolute_errors_m(both, "se3")),
        "rpe_m": rmse(steps_m), "rpe_rad": rmse(steps_rad),
        "lost_share": float(np.mean(flags)), "cpu_ms": 1e3 * float(np.median(cpu[1:])),
        "wait_ms": 1e3 * float(np.median(waited[1:-1])), "read_ms": reading_ms(folder, settings),
    }


def reading_ms(folder: Path, settings: dict) -> float:
    """CPU milliseconds per view of reading and decoding alone, the reader's thread included."""
    source = registry.load("source", "replay")(path=str(folder), **settings).build(
        SourceContext(generator(0, "source"), None, Path(tempfile.gettempdir())))
    views = 0
    while source.lead() is not None:
        if views == 0:  # the first brings the imports
            begin = time.process_time()
        views += 1
    source.close()
    return 1e3 * (time.process_time() - begin) / max(views - 2, 1)  # one was read ahead by then


if __name__ == "__main__":
    main()
