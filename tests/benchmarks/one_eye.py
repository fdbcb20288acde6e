"""One-eye odometries on simulated surveys, no alignment anywhere:

    python tests/benchmarks/one_eye.py --tracks /tmp/tracks            # all cases; surveys are rendered once and kept
    python tests/benchmarks/one_eye.py --tracks /tmp/tracks square     # one case

A case is a world with settings of the source, some seeds and directions, and the filters to try on the same tracks.
Writes one row per run to OUT/one_eye_runs.csv, and per case and filter the number of runs, how many failed (ever more
than one metre wrong), medians, largest values and a 95 % bootstrap interval of the median ATE to OUT/one_eye.csv.
The seed moves paintings, wobble, command errors and image noise. Times are CPU times of one process.
On a closed square an error of scale alone cancels at the end: read ATE and the error half way beside the end error.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rhs.compose import build_parts, compose_config
from rhs.world import load_world
from rhs_odometry.klt import KltSettings, KltTracker
from rhs_odometry.replay import figures, replay
from rhs_odometry.track_frames import Tracks, load_tracks, save_tracks

COMMAND: dict[str, Any] = {}
INPUTS = {
    "command + height + width": ("corridor_ekf", COMMAND),
    "wheels + height + width": ("corridor_ekf", {"motion": "wheel"}),
    "command + height": ("corridor_ekf", {"width_m": 0.0}),
    "command + width": ("corridor_ekf", {"height_known": False}),
    "nothing + height + width": ("corridor_ekf", {"motion": "none"}),
    "no right angles (5.7 deg)": ("corridor_ekf", {"right_angle_sigma_deg": 5.7}),
    "width 30 % wrong and soft": ("corridor_ekf", {"width_m": 2.6, "width_sigma_m": 0.6}),
}
THESIS = {
    "section_ekf (thesis)": ("section_ekf", {"aspect": 1.3}),
    "tube_ekf (thesis)": ("tube_ekf", {}),
    "corridor_ekf": ("corridor_ekf", COMMAND),
}
MAIN = {k: INPUTS[k] for k in ("command + height + width", "nothing + height + width")}
SWAYING = {
    "command, tilt as states": ("corridor_ekf", {"wobble_sigma_deg": 1.2}),
    "command, tilt ignored": ("corridor_ekf", COMMAND),
}


@dataclass(frozen=True)
class Case:
    """words: overrides of the survey; runs: (seed, direction); filters by label."""

    words: tuple[str, ...]
    runs: tuple[tuple[int, str], ...]
    filters: dict[str, tuple[str, dict[str, Any]]] = field(default_factory=lambda: MAIN)


BOTH = tuple((seed, way) for seed in range(3) for way in ("ccw", "cw"))
SIX = tuple((seed, "ccw") for seed in range(6))
CASES = {
    "corridor": Case(("world=corridor",), SIX, THESIS),
    "two_corridors": Case(("world=two_corridors",), SIX, THESIS),
    "square": Case(("world=square",), BOTH, {**INPUTS, **THESIS}),
    "square_pivot": Case(("world=square", "source.turn=pivot"), ((0, "ccw"), (1, "cw")), MAIN),
    "square_sparse": Case(("world=square", "source.paintings_density=0.35"), ((0, "ccw"), (1, "cw")), MAIN),
    "square_sway": Case(("world=square", "source.pitch_roll_deg=1.0"), ((0, "ccw"), (1, "cw")), SWAYING),
    "lobby": Case(("world=lobby",), tuple((seed, "ccw") for seed in range(3)), THESIS),
}
SHOWN = ("ate_m", "half_way_error_m", "end_error_m", "end_error_percent", "yaw_after_corner_deg", "nees_median",
         "doubted_share", "walls", "cpu_ms_median", "cpu_ms_p95")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=list(CASES))
    parser.add_argument("--tracks", type=Path, required=True, help="folder for the surveys' tracks")
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    chosen.tracks.mkdir(parents=True, exist_ok=True)
    rows = [row for name in chosen.cases for row in run_case(name, CASES[name], chosen.tracks)]
    write(chosen.out / "one_eye_runs.csv", rows)
    groups = dict.fromkeys((row["case"], row["filter"]) for row in rows)
    table = [summary([r for r in rows if (r["case"], r["filter"]) == group]) for group in groups]
    write(chosen.out / "one_eye.csv", table)
    print((chosen.out / "one_eye.csv").read_text())


def run_case(name: str, case: Case, folder: Path) -> list[dict[str, Any]]:
    rows = []
    for seed, way in case.runs:
        tracks = survey(folder / f"{name}_{way}{seed}.npz", case.words, seed, way)
        for label, (odometry, settings) in case.filters.items():
            run = figures(replay(odometry, settings, tracks))
            rows.append({"case": name, "filter": label, "seed": seed, "direction": way, **run})
            print(name, way, seed, label, f"ate {run['ate_m']:.3f} end {run['end_error_m']:.3f}", flush=True)
    return rows


def survey(file: Path, words: tuple[str, ...], seed: int, way: str) -> Tracks:
    """Tracks of the survey, rendered if the file is not there."""
    if file.exists():
        return load_tracks(file)
    look = f"source.texture_seed={seed}"
    config = compose_config(["sensor=mono", f"seed={seed}", look, f"source.direction={way}", *words])
    with tempfile.TemporaryDirectory() as folder:
        parts = build_parts(config, load_world(config.world), Path(folder))
        tracker, frames, truth = KltTracker(KltSettings()), [], []
        while (capture := parts.source.lead()) is not None:
            frames.append(tracker.track(parts.sensor.sense(capture)))
            truth.append(parts.source.truth())
        tracks = Tracks(parts.source.camera, np.array(parts.source.facts.start), frames, np.stack(truth))
        parts.source.close()
    save_tracks(file, tracks)
    return tracks


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    values = {k: np.array([r[k] for r in rows]) for k in (*SHOWN, "largest_error_m")}
    rng = np.random.default_rng(0)
    resampled = np.median(rng.choice(values["ate_m"], (2000, len(rows))), axis=1)
    out: dict[str, Any] = {"case": rows[0]["case"], "filter": rows[0]["filter"], "runs": len(rows),
                           "failed": int((values["largest_error_m"] > 1.0).sum()),
                           "ate_m_low": np.percentile(resampled, 2.5), "ate_m_high": np.percentile(resampled, 97.5)}
    for name in SHOWN:
        known = values[name][np.isfinite(values[name])]
        out[f"{name}_median"] = np.median(known) if len(known) else np.nan
        out[f"{name}_max"] = known.max() if len(known) else np.nan
    return out


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})


if __name__ == "__main__":
    main()
