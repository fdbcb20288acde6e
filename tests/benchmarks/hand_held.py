"""The RGB-D back end on hand-held recordings that are made here: `python tests/benchmarks/hand_held.py --rooms 0 1`.

Each room (hand_held_made.py) is seen along each of the ways and written as a TUM folder; the whole chain is replayed on it
by the command line, ORB-SLAM3's wheel beside it in a process of its own (--peers, extra `peers`). Rooms below 100 are to
build on, from 100 only to judge by. Written to results/tables/hand_held.csv, per recording:

ate_cm, as reported view by view; closed_cm, after the end (SE(3) alignment); rpe_mm per view; size: metres of the closed
estimate over the true ones; checked, loops, false: pairs of views looked at, loops taken, and those of them off by more
than 15 cm or 5 degrees; refused_true: loops refused that were within that; lost: views without a measured motion; cpu_ms of
odometry and chain a view; memory_mb of the process. orb_cm, orb_size, orb_share: ORB-SLAM3's trajectory at its end, the
share of views it has.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import hand_held_made as made  # noqa: E402
import numpy as np  # noqa: E402
from odometry_recordings import ROOT  # noqa: E402
from shared import write  # noqa: E402

from rhs.api.geometry import inverse, log_so3  # noqa: E402
from rhs.api.trajectory import Trajectory, read_tum  # noqa: E402
from rhs.metrics.accuracy import absolute_errors_m, pair, rmse  # noqa: E402

HERE = Path(__file__).resolve().parent
REAL_HAND = ROOT / "tum_fr1_rpy_60" / "groundtruth.txt"
FALSE_M, FALSE_DEG = 0.15, 5.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--ways", nargs="+", default=list(made.WAYS), choices=made.WAYS)
    parser.add_argument("--views", type=int, default=400)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--peers", action="store_true", help="ORB-SLAM3's wheel beside ours")
    parser.add_argument("--kept", type=Path, help="folder of the recordings; made where they are not there")
    parser.add_argument("--words", nargs="*", default=[], help="of the command line, such as loop_closer.checks=120")
    parser.add_argument("--out", type=Path, default=Path("results/tables/hand_held.csv"))
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in chosen.rooms:
            for way in chosen.ways:
                if way == "nod" and not REAL_HAND.is_file():
                    print(f"nod: {REAL_HAND} is absent, skipped")
                    continue
                folder = (chosen.kept or Path(scratch)) / f"{way}_{seed}"
                if not (folder / "groundtruth.txt").is_file():
                    made.write(folder, way, seed, views=chosen.views, width=chosen.width, nod=REAL_HAND)
                rows.append({"way": way, "room": seed, **ours(folder, Path(scratch) / f"run_{way}_{seed}", chosen)})
                if chosen.peers:
                    rows[-1] |= orb_slam3(folder, Path(scratch) / "orb", chosen.width)
                print(*(f"{v:.4g}" if isinstance(v, float) else v for v in rows[-1].values()), flush=True)
                write(chosen.out, rows)


def ours(folder: Path, out: Path, chosen) -> dict[str, Any]:
    """The chain on a recording, as a person types it."""
    camera = made.camera_of(chosen.width)
    words = ["source=replay", f"source.path={folder}", f"source.camera=[{camera.fx},{camera.fy},{camera.cx},{camera.cy}]",
             "task=survey", "recording=off", "pictures=off", f"output={out}", *chosen.words]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run([sys.executable, "-m", "rhs", *words], capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if not (out / "closure.json").is_file():  # a survey that was hardly tracked has its row all the same
        raise SystemExit(run.stdout + run.stderr)
    row, truth = json.loads((out / "row.json").read_text()), read_tum(out / "truth_survey.tum")
    closed, closure = read_tum(out / "corrected.tum"), json.loads((out / "closure.json").read_text())
    loops = [(edge["accepted"], is_false(edge, truth.poses)) for edge in closure["edges"]]
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"views": len(truth), "way_m": float(truth.travelled_m[-1]), "ate_cm": 100 * row["ate_before_closing_m"],
            "closed_cm": 100 * row["ate_rmse_m"], "rpe_mm": 1e3 * row["rpe_trans_m"], "size": size(closed, truth),
            "checked": int(closure["details"].get("pairs_checked", 0)), "loops": sum(taken for taken, _ in loops),
            "false": sum(taken and false for taken, false in loops),
            "refused_true": sum(not taken and not false for taken, false in loops),
            "lost": round(row["lost_share"] * len(truth)), "odometry_ms": row["odometry_ms"],
            "cpu_ms": 1e3 * cpu_s / len(truth), "memory_mb": row["peak_memory_mb"]}


def is_false(edge: dict[str, Any], truth: np.ndarray) -> bool:
    """Whether an edge of closure.json is wrong, by the true poses (N, 4, 4)."""
    gap = inverse(truth[edge["later"]]) @ truth[edge["earlier"]] @ np.array(edge["earlier_from_later"]).reshape(4, 4)
    turned_deg = np.degrees(np.linalg.norm(log_so3(gap[:3, :3])))
    return bool(np.linalg.norm(gap[:3, 3]) > FALSE_M or turned_deg > FALSE_DEG)


def size(estimate: Trajectory, truth: Trajectory) -> float:
    """Spread of the estimate's positions over that of the true ones."""
    both = pair(estimate, truth, 1e-4)
    spreads = [t.poses[:, :3, 3] - t.poses[:, :3, 3].mean(axis=0) for t in (both.estimate, both.truth)]
    return float(np.linalg.norm(spreads[0]) / np.linalg.norm(spreads[1]))


def orb_slam3(folder: Path, out: Path, width: int) -> dict[str, Any]:
    """The wheel on the same frames (peers_others.py)."""
    camera = made.camera_of(width)
    known = {"width": camera.width, "height": camera.height, "fx": camera.fx, "fy": camera.fy, "cx": camera.cx,
             "cy": camera.cy, "distortion": [], "readout_s": 0.0}
    (folder / "camera.json").write_text(json.dumps(known))
    subprocess.run([sys.executable, str(HERE / "peers_others.py"), str(folder), "orb_slam3", str(out), "0"],
                   capture_output=True, check=False)
    found = out.with_name("orb_settled.txt")
    if not found.is_file():
        return {"orb_cm": float("nan"), "orb_size": float("nan"), "orb_share": 0.0}
    truth, estimate = read_tum(folder / "groundtruth.txt"), read_tum(found)
    both = pair(estimate, truth, 1e-4)
    found.unlink()
    return {"orb_cm": 100 * rmse(absolute_errors_m(both, "se3")), "orb_size": size(estimate, truth),
            "orb_share": len(estimate) / len(truth)}


if __name__ == "__main__":
    main()
