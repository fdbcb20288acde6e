"""Ours beside ORB-SLAM3 and Open3D on the same RGB-D frames, judged by evo: ATE, CPU and memory in one table.

    pip install -e '.[peers]'
    python tests/benchmarks/peers_rgbd.py source.path=FOLDER source.camera=tum_fr1 [--seeds 3] [--vocabulary ORBvoc.txt]

The frames are written once as a TUM folder, which every method reads in a process of its own; ORB-SLAM3 (pyorbslam3) and
evo are GPL and never share one with rhs. Poses are those reported when each view came; `settled`: ours after revise(),
ORB-SLAM3's own trajectory at the end. ate_cm: evo, SE(3) alignment, over the views that a method has a pose for (share).
size: metres of the estimate over those of the truth. cpu_ms: of the whole process per view while it tracks, all threads,
mean. memory_mb: most that the process held. ORB-SLAM3's vocabulary is fetched by the wheel, or given, or without both
trained on the frames themselves (peers_vocabulary.py; the column says so): it serves loops and relocalisation.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

HERE = Path(__file__).resolve().parent
OURS = ("keyframe", "procrustes", "orb")
PEERS = ("orb_slam3", "open3d_hybrid")
PUBLISHED = Path("results/tables/peers_rgbd.csv")
NEEDS = {"orb_slam3": "pyorbslam3", "open3d_hybrid": "open3d"}  # modules of extras; evo judges every method
EVO = """
import json, sys
from evo.core import metrics, sync
from evo.tools import file_interface
truth, found = (file_interface.read_tum_trajectory_file(name) for name in sys.argv[1:3])
truth, found = sync.associate_trajectories(truth, found, max_diff=1e-4)
raw = found.positions_xyz - found.positions_xyz.mean(axis=0), truth.positions_xyz - truth.positions_xyz.mean(axis=0)
found.align(truth)
ape = metrics.APE(metrics.PoseRelation.translation_part)
ape.process_data((truth, found))
size = (raw[0] ** 2).sum() ** 0.5 / (raw[1] ** 2).sum() ** 0.5
print(json.dumps({"ate_cm": 100 * ape.get_statistic(metrics.StatisticsType.rmse), "size": size, "n": found.num_poses}))
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="+", help="source.path=FOLDER source.camera=... as of a run")
    parser.add_argument("--methods", nargs="+", default=[*OURS, *PEERS], choices=[*OURS, *PEERS])
    parser.add_argument("--seeds", type=int, default=1, help="runs of each method")
    parser.add_argument("--vocabulary", default=os.environ.get("PYORBSLAM3_VOCAB", ""))
    parser.add_argument("--out", type=Path,
                        help=f"table to write; with all methods {PUBLISHED}, with some none")
    chosen = parser.parse_args()
    out = chosen.out or (PUBLISHED if {*OURS, *PEERS} <= {*chosen.methods} else None)
    if missing := not_installed(chosen.methods):
        print(f"peers_rgbd: {', '.join(missing)} not installed; type pip install -e '.[peers]', or --methods "
              f"{' '.join(OURS)} (these need evo); nothing was run or written", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written = subprocess.run([sys.executable, str(HERE / "peers_frames.py"), str(folder), *chosen.words], check=False)
        if written.returncode:
            return written.returncode
        rows = [row for method in chosen.methods for seed in range(chosen.seeds)
                for row in judged(folder, method, seed, chosen.vocabulary)]
    if failed := [row for row in rows if row["note"].startswith(("failed", "evo"))]:
        print(f"peers_rgbd: {failed[0]['method']} {failed[0]['note']}; no table is written", file=sys.stderr)
        return 1
    if out is not None:
        write(out, rows)
        print(out.read_text())
    return 0


def not_installed(methods: list[str]) -> list[str]:
    """The modules that these methods, or their judge, would need and that are not there."""
    return [name for name in ["evo", *(NEEDS[one] for one in methods if one in NEEDS)]
            if importlib.util.find_spec(name) is None]


def judged(folder: Path, method: str, seed: int, vocabulary: str) -> list[dict[str, Any]]:
    """A row for the poses as reported and one for the settled ones; why there are none."""
    worker = "peers_ours.py" if method in OURS else "peers_others.py"
    out = folder / f"{method}_{seed}"
    said, memory_mb = watched([str(HERE / worker), str(folder), method, str(out), str(seed), vocabulary])
    rows = []
    for poses in ("reported", "settled"):
        file = out.with_name(f"{out.name}_{poses}.txt")
        row = {"method": method, "seed": seed, "poses": poses, "ate_cm": float("nan"), "size": float("nan"), "share": 0.0,
               "cpu_ms": said.get("cpu_ms", float("nan")), "memory_mb": memory_mb, "note": said.get("note", "")}
        if file.is_file() and len(file.read_text().splitlines()) > 2:
            evo = subprocess.run([sys.executable, "-c", EVO, str(folder / "groundtruth.txt"), str(file)],
                                 capture_output=True, text=True, check=False)
            if evo.returncode:
                row["note"] = f"evo: {evo.stderr.strip().splitlines()[-1]}"
            else:
                figures = json.loads(evo.stdout)
                row |= {"ate_cm": figures["ate_cm"], "size": figures["size"], "share": figures["n"] / said["views"]}
        elif poses == "settled":
            continue
        rows.append(row)
        print(*row.values(), flush=True)
    return rows


def watched(words: list[str]) -> tuple[dict[str, Any], float]:
    """What a worker says in its last line, and the most memory it held, megabytes."""
    with tempfile.TemporaryFile("w+") as said, tempfile.TemporaryFile("w+") as errors:
        child = subprocess.Popen([sys.executable, *words], stdout=said, stderr=errors)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        errors.seek(0)
        lines, wrong = said.read().splitlines(), errors.read().splitlines()
    answer = [line for line in lines if line.startswith("{")]
    if child.returncode or not answer:
        return {"note": f"failed ({child.returncode}): {wrong[-1] if wrong else 'said nothing'}"}, usage.ru_maxrss / 1024
    return json.loads(answer[-1]), usage.ru_maxrss / 1024


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    import csv

    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


if __name__ == "__main__":
    sys.exit(main())
