"""The thesis's filters on points of a section with a known answer (T2, T8): no pictures, so a run takes seconds.

    python tests/benchmarks/section_start.py --seeds 6

T2: 50 steps of 0.1 m, started wrong by 0.5 m in x, y or z, by 10 degrees about one axis, by both everywhere, or right. The
thesis linearises a view once; where angles are wrong the filter does so three times.
T8: 80 steps of 0.125 m straight on, the section known. Corner: 16 m, then round a right angle, 9 m: it must fail.
section_ekf runs in a corridor of 2 x 2.5 m, tube_ekf in a tube of radius 1.12 m and (its shape being wrong) in the corridor.
Axes: x along the corridor, y across, z up. Errors at the last view, unaligned. Writes OUT/section_start_runs.csv and, per
case and filter, medians, largest values and how many runs missed their target, to OUT/section_start.csv.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from shared import write

from rhs.api.geometry import camera_from_fov, inverse, log_so3, se2
from rhs_odometry.section.config import SectionEkf, TubeEkf
from rhs_odometry.section.ekf import section_core
from rhs_odometry.tracks import synthetic
from rhs_odometry.tracks.monocular import MonocularOdometry
from rhs_odometry.tracks.track_frames import TrackFrame, Tracks

RADIUS_M = 1.12
WIDE: dict[str, Any] = {"start_sigma_m": 0.5}
TURNED: dict[str, Any] = {"start_sigma_deg": 10.0, "iterations": 3}
M, DEG = 0.5, 10.0
STARTS: dict[str, dict[str, Any]] = {
    "T2 right": {},
    "T2 x 0.5 m": {"start_error_m": [M, 0.0, 0.0], **WIDE},
    "T2 y 0.5 m": {"start_error_m": [0.0, M, 0.0], **WIDE},
    "T2 z 0.5 m": {"start_error_m": [0.0, 0.0, M], **WIDE},
    "T2 y 0.5 m, 3 linearisations": {"start_error_m": [0.0, M, 0.0], "iterations": 3, **WIDE},
    "T2 roll 10 deg": {"start_error_deg": [DEG, 0.0, 0.0], **TURNED},
    "T2 pitch 10 deg": {"start_error_deg": [0.0, DEG, 0.0], **TURNED},
    "T2 yaw 10 deg": {"start_error_deg": [0.0, 0.0, DEG], **TURNED},
    "T2 all of them": {"start_error_m": [M, M, M], "start_error_deg": [DEG, DEG, DEG], **WIDE, **TURNED},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
        rows += one_seed(seed)
        write(chosen.out / "section_start_runs.csv", rows)
    groups = dict.fromkeys((row["case"], row["filter"]) for row in rows)
    write(chosen.out / "section_start.csv", [summary(rows, *group) for group in groups])
    print((chosen.out / "section_start.csv").read_text())


def one_seed(seed: int) -> list[dict[str, Any]]:
    """All cases on the same tracks."""
    rows = []
    box50, tube50 = straight(seed, 5.0, 0.1, round_=False), straight(seed, 5.0, 0.1, round_=True)
    for case, settings in STARTS.items():
        rows.append(run(case, "section_ekf in the corridor", seed, box50, SectionEkf(speed_mps=0.4, **settings)))
        rows.append(run(case, "tube_ekf in the tube", seed, tube50, TubeEkf(speed_mps=0.4, **settings)))
    box80, tube80 = straight(seed, 10.0, 0.125, round_=False), straight(seed, 10.0, 0.125, round_=True)
    rows.append(run("T8 straight", "section_ekf in the corridor", seed, box80, SectionEkf()))
    rows.append(run("T8 straight", "tube_ekf in the tube", seed, tube80, TubeEkf()))
    rows.append(run("T8 straight", "tube_ekf in the corridor", seed, box80, TubeEkf()))
    corner = synthetic.corridor_path(np.array([[3.0, 1.0], [19.0, 1.0], [19.0, 10.0]]))
    bent = synthetic.synthetic_tracks(synthetic.square_plan(), corner, np.random.default_rng(seed))
    rows.append(run("corner", "section_ekf in the corridor", seed, bent, SectionEkf()))
    rows.append(run("corner", "tube_ekf in the corridor", seed, bent, TubeEkf()))
    return rows


def straight(seed: int, length_m: float, step_m: float, *, round_: bool) -> Tracks:
    """Tracks along the middle of a corridor of 2 x 2.5 m, or of a tube of RADIUS_M, of random points on its wall."""
    rng = np.random.default_rng(seed)
    path = synthetic.corridor_path(np.array([[0.0, 0.0], [length_m, 0.0]]), step_m=step_m)
    if not round_:
        return synthetic.synthetic_tracks(synthetic.straight_plan(length_m + 6.0), path, rng)
    along, angle = rng.uniform(-2.0, length_m + 6.0, 6000), rng.uniform(0.0, 2 * np.pi, 6000)
    points = np.stack([along, RADIUS_M * np.sin(angle), RADIUS_M * (1.0 + np.cos(angle))], axis=1)
    camera = camera_from_fov(320, 240, 57.0, height_m=RADIUS_M + 0.05)
    imager = synthetic.Imager(synthetic.FloorPlan(np.zeros((0, 2, 2))), points, camera, synthetic.TrackNoise())
    frames = [TrackFrame(0.25 * i, *imager.see(pose, rng)) for i, pose in enumerate(path)]
    return Tracks(camera, path[0].copy(), frames, np.stack([se2(*p) for p in path]))


def run(case: str, name: str, seed: int, tracks: Tracks, settings: SectionEkf) -> dict[str, Any]:
    eye = MonocularOdometry(None, section_core(settings, tracks.camera, tracks.start), se2(*tracks.start))
    pose, gaps = se2(*tracks.start), []
    for frame, truth in zip(tracks.frames, tracks.truth, strict=True):
        pose = pose @ eye.update_tracks(frame).previous_from_body
        gaps.append(inverse(truth) @ pose)
    gap, first = gaps[-1], gaps[1]
    way = float(np.linalg.norm(np.diff(tracks.truth[:, :3, 3], axis=0), axis=1).sum())
    position, turn = gap[:3, 3], np.degrees(np.abs(log_so3(gap[:3, :3])))
    across = float(np.hypot(position[1], position[2]))
    total = float(np.linalg.norm(position))
    return {"case": case, "filter": name, "seed": seed, "way_m": way, "first_error_m": float(np.linalg.norm(first[:3, 3])),
            "end_error_m": total, "end_error_percent": 100.0 * total / way, "across_m": across,
            "along_m": float(abs(position[0])), "angle_deg": float(turn.max()),
            "reached": reached(case, total, 100.0 * total / way, float(turn.max()))}


def reached(case: str, end_m: float, percent: float, angle_deg: float) -> bool:
    """The targets: 0.05 m after 50 steps; 0.7 % and 1 degree straight on; within a metre behind the corner."""
    if case.startswith("T2"):
        return end_m <= 0.05
    return percent <= 0.7 and angle_deg <= 1.0 if case.startswith("T8") else end_m <= 1.0


def summary(rows: list[dict[str, Any]], case: str, name: str) -> dict[str, Any]:
    mine = [row for row in rows if (row["case"], row["filter"]) == (case, name)]
    out: dict[str, Any] = {"case": case, "filter": name, "runs": len(mine), "reached": sum(r["reached"] for r in mine)}
    for column in ("end_error_m", "end_error_percent", "across_m", "along_m", "angle_deg"):
        values = np.array([row[column] for row in mine])
        draws = np.median(np.random.default_rng(0).choice(values, (2000, len(values))), axis=1)
        out[f"{column}_median"] = float(np.median(values))
        out[f"{column}_95"] = f"{np.percentile(draws, 2.5):.3g}..{np.percentile(draws, 97.5):.3g}"
        out[f"{column}_max"] = float(values.max())
    return out


if __name__ == "__main__":
    main()
