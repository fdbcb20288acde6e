"""One-eye odometries on simulated surveys, no alignment anywhere:

    python tests/benchmarks/monocular.py --tracks /tmp/tracks            # all cases; surveys are rendered once and kept
    python tests/benchmarks/monocular.py --tracks /tmp/tracks square     # one case
    python tests/benchmarks/monocular.py --tracks /tmp/tracks square --runs 4 --filters command   # part of one

Rows of earlier calls in OUT are kept; the same run again replaces its row. Begin in an empty OUT where the code changed.

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
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from shared import write

from rhs.api.floorplan import World
from rhs.api.geometry import planar, se2
from rhs.api.records import Wall
from rhs.base.strict_yaml import load_yaml
from rhs.config.compose import compose_config
from rhs.config.parts import build
from rhs.estimation.scans.wall_rays import cast_on_walls
from rhs.worlds.world import load_world
from rhs_mappers.occupancy import OccupancyMapper
from rhs_mappers.occupancy_config import Occupancy
from rhs_odometry.tracks.klt import KltTracker
from rhs_odometry.tracks.replay import FilterRun, figures, run_filter
from rhs_odometry.tracks.settings import KltSettings
from rhs_odometry.tracks.track_frames import Tracks, load_tracks, save_tracks

PLAN = Path(__file__).parents[2] / "conf" / "odometry" / "corridor_ekf_2m.yaml"
COMMAND: dict[str, Any] = {key: value for key, value in load_yaml(PLAN).items() if key != "defaults"}
INPUTS = {
    "command + height + width": ("corridor_ekf", COMMAND),
    "wheels + height + width": ("corridor_ekf", {**COMMAND, "motion": "wheel"}),
    "command + height": ("corridor_ekf", {**COMMAND, "width_m": 0.0}),
    "command + width": ("corridor_ekf", {**COMMAND, "height_known": False}),
    "nothing + height + width": ("corridor_ekf", {**COMMAND, "motion": "none"}),
    "no right angles (5.7 deg)": ("corridor_ekf", {**COMMAND, "right_angle_sigma_deg": 5.7}),
    "width 30 % wrong and soft": ("corridor_ekf", {**COMMAND, "width_m": 2.6, "width_sigma_m": 0.6}),
    "defaults: an unknown building": ("corridor_ekf", {}),
}
THESIS = {
    "section_ekf (thesis)": ("section_ekf", {"aspect": 1.3}),
    "tube_ekf (thesis)": ("tube_ekf", {}),
    "corridor_ekf": ("corridor_ekf", COMMAND),
}
MAIN = {k: INPUTS[k] for k in ("command + height + width", "nothing + height + width")}
SWAYING = {
    "command, tilt as states": ("corridor_ekf", {**COMMAND, "wobble_sigma_deg": 1.2}),
    "command, tilt ignored": ("corridor_ekf", COMMAND),
}


@dataclass(frozen=True)
class Case:
    """words: overrides of the survey; runs: (seed, direction); filters by label."""

    words: tuple[str, ...]
    runs: tuple[tuple[int, str], ...]
    filters: dict[str, tuple[str, dict[str, Any]]] = field(default_factory=lambda: MAIN)


TWELVE = tuple((seed, way) for seed in range(6) for way in ("ccw", "cw"))
SIX = TWELVE[:6]
CASES = {
    "corridor": Case(("world=corridor",), TWELVE, THESIS),
    "two_corridors": Case(("world=two_corridors",), TWELVE, THESIS),
    "square": Case(("world=square",), TWELVE, INPUTS),
    "square_pivot": Case(("world=square", "source.turn=pivot"), SIX, MAIN),
    "square_sparse": Case(("world=square", "source.paintings_density=0.35"), SIX, MAIN),
    "square_sway": Case(("world=square", "source.pitch_roll_deg=1.0"), SIX, SWAYING),
    "lobby": Case(("world=lobby",), SIX, THESIS),
}
SHOWN = ("ate_m", "half_way_error_m", "end_error_m", "end_error_percent", "yaw_after_corner_deg", "nees_median",
         "doubted_share", "offset_median_m", "offset_max_m", "cpu_ms_median", "cpu_ms_p95", "tracking_ms_median",
         "tracking_ms_p95")
MAP = ("true_walls", "walls", "walls_found", "free_iou")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=list(CASES))
    parser.add_argument("--tracks", type=Path, required=True, help="folder for the surveys' tracks")
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    parser.add_argument("--runs", type=int, default=12, help="at most so many runs of each case, the first ones")
    parser.add_argument("--filters", nargs="*", default=[""], help="only filters of this label, or whose label begins so")
    chosen = parser.parse_args()
    chosen.tracks.mkdir(parents=True, exist_ok=True)
    kept = read(chosen.out / "one_eye_runs.csv")
    for name in chosen.cases:
        case = CASES[name]
        filters = {k: v for k, v in case.filters.items()
                   if any(k == wanted or (wanted not in case.filters and k.startswith(wanted)) for wanted in chosen.filters)}
        for row in run_case(name, replace(case, runs=case.runs[: chosen.runs], filters=filters), chosen.tracks):
            kept[key(row)] = row
            rows = sorted(kept.values(), key=order)
            write(chosen.out / "one_eye_runs.csv", rows)
    groups = dict.fromkeys((row["case"], row["filter"]) for row in rows)
    table = [summary([r for r in rows if (r["case"], r["filter"]) == group]) for group in groups]
    write(chosen.out / "one_eye.csv", table)
    print((chosen.out / "one_eye.csv").read_text())


def key(row: dict[str, Any]) -> tuple[str, ...]:
    return tuple(str(row[name]) for name in ("case", "filter", "seed", "direction"))


def order(row: dict[str, Any]) -> tuple[int, int, int, str]:
    case = row["case"]
    return list(CASES).index(case), list(CASES[case].filters).index(row["filter"]), int(row["seed"]), row["direction"]


def read(path: Path) -> dict[tuple[str, ...], dict[str, Any]]:
    """The rows of earlier calls, numbers as numbers, by what makes them one run."""
    if not path.exists():
        return {}
    with path.open(newline="") as file:
        rows = [{k: v if k in ("case", "filter", "direction") else float(v) for k, v in row.items()}
                for row in csv.DictReader(file)]
    return {key(row): row for row in ({**row, "seed": int(row["seed"])} for row in rows)}


def run_case(name: str, case: Case, folder: Path) -> Iterator[dict[str, Any]]:
    world = load_world(case.words[0].removeprefix("world="))
    for seed, way in case.runs:
        tracks, spent_ms = survey(folder / f"{name}_{way}{seed}.npz", case.words, seed, way)
        tracking = {"tracking_ms_median": float(np.median(spent_ms)), "tracking_ms_p95": float(np.percentile(spent_ms, 95))}
        true_free = drawn_truth(world, tracks)
        for label, (odometry, settings) in case.filters.items():
            played = run_filter(odometry, settings, tracks)
            run = {**figures(played), **map_figures(played, world, true_free), **tracking}
            print(name, way, seed, label, f"ate {run['ate_m']:.3f} end {run['end_error_m']:.3f}", flush=True)
            yield {"case": name, "filter": label, "seed": seed, "direction": way, **run}


def map_figures(run: FilterRun, world: World, true_free: np.ndarray) -> dict[str, float]:
    """Walls found: true walls longer than a metre with a wall of the filter along at least half of them, no more than
    0.3 m off; their offsets. Free-space IoU of the map drawn from the filter's poses and walls against the same beams
    drawn from the true poses and walls, without alignment, cells of 0.1 m."""
    truth = long_walls(world)
    gaps = np.array([offset_m(s, run.walls) for s in truth])
    found = gaps[gaps <= 0.3]
    out = {"true_walls": float(len(truth)), "walls_found": float(len(found)), "free_iou": np.nan,
           "offset_median_m": float(np.median(found)) if len(found) else np.nan,
           "offset_max_m": float(found.max()) if len(found) else np.nan}
    if run.revision is not None and run.walls:
        free = drawn(world, run.revision.poses, run.revision.scans)
        out["free_iou"] = float((free & true_free).sum() / (free | true_free).sum())
    return out


def long_walls(world: World) -> list[np.ndarray]:
    return [s for wall in world.walls for s in wall.segments_m if np.linalg.norm(s[1] - s[0]) > 1.0]


def drawn_truth(world: World, tracks: Tracks) -> np.ndarray:
    real, poses = [Wall(s[0], s[1]) for s in long_walls(world)], [se2(*planar(pose)) for pose in tracks.truth]
    beams, reach = np.linspace(-np.pi, np.pi, 720, endpoint=False), 4.0
    return drawn(world, poses, [cast_on_walls(real, pose, beams, reach) for pose in poses])


def offset_m(true: np.ndarray, walls: Sequence[Wall]) -> float:
    """Mean distance, by length, of the walls that run along the true segment (2, 2) within 0.3 m of it; inf if they cover
    less than half of it."""
    length = np.linalg.norm(true[1] - true[0])
    along = (true[1] - true[0]) / length
    across = np.array([-along[1], along[0]])
    covered, mean, weight = np.zeros(int(10 * length), bool), 0.0, 0.0
    for wall in walls:
        ends = np.stack([wall.start_xy_m, wall.end_xy_m]) - true[0]
        span, off = np.sort(ends @ along), ends @ across
        if abs(np.diff(ends @ along)[0]) < np.linalg.norm(ends[1] - ends[0]) * 0.9 or np.abs(off).mean() > 0.3:
            continue
        low, high = np.clip(span, 0.0, length)
        if high > low:
            covered[int(10 * low): int(10 * high)] = True
            mean, weight = mean + (high - low) * abs(off.mean()), weight + (high - low)
    return mean / weight if weight and covered.mean() >= 0.5 else np.inf


def drawn(world: World, poses: Any, scans: Any) -> np.ndarray:
    """(H, W) bool: what the ordinary mapper calls free."""
    points = np.concatenate([wall.points_m for wall in world.walls])
    bounds = (*(points.min(axis=0) - 1.0), *(points.max(axis=0) + 1.0))
    mapper = OccupancyMapper(Occupancy(), bounds)
    for pose, scan in zip(poses, scans, strict=True):
        if scan is not None:
            mapper.update(pose, scan)
    return mapper.grid().free()


def survey(file: Path, words: tuple[str, ...], seed: int, way: str) -> tuple[Tracks, np.ndarray]:
    """Tracks of the survey, rendered if the file is not there, and the CPU ms that following took in each view."""
    times = file.with_suffix(".ms.npy")
    if file.exists():
        return load_tracks(file), np.load(times)
    look = f"source.texture_seed={seed + 1}"
    config = compose_config(["sensor=mono", f"seed={seed}", look, f"source.direction={way}", *words])
    with tempfile.TemporaryDirectory() as folder:
        parts = build(config.parts, seed=config.seed, world=load_world(config.world), folder=Path(folder),
                      features=config.features)
        tracker, frames, truth, spent_ms = KltTracker(KltSettings()), [], [], []
        while (capture := parts.source.lead()) is not None:
            observation, begin = parts.sensor.sense(capture), time.process_time()
            frames.append(tracker.track(observation))
            spent_ms.append(1e3 * (time.process_time() - begin))
            truth.append(parts.source.truth())
        tracks = Tracks(parts.source.camera, np.array(parts.source.facts.start), frames, np.stack(truth))
        parts.source.close()
    np.save(times, spent_ms)
    save_tracks(file, tracks)
    return tracks, np.array(spent_ms)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    values = {k: np.array([r[k] for r in rows]) for k in (*SHOWN, *MAP, "largest_error_m")}
    rng = np.random.default_rng(0)
    resampled = np.median(rng.choice(values["ate_m"], (2000, len(rows))), axis=1)
    out: dict[str, Any] = {"case": rows[0]["case"], "filter": rows[0]["filter"], "runs": len(rows),
                           "failed": int((values["largest_error_m"] > 1.0).sum()),
                           "ate_m_low": np.percentile(resampled, 2.5), "ate_m_high": np.percentile(resampled, 97.5)}
    for name in SHOWN:
        known = values[name][np.isfinite(values[name])]
        out[f"{name}_median"] = np.median(known) if len(known) else np.nan
        out[f"{name}_max"] = known.max() if len(known) else np.nan
    for name in MAP:
        known = values[name][np.isfinite(values[name])]
        out[f"{name}_median"], out[f"{name}_min"] = (np.median(known), known.min()) if len(known) else (np.nan, np.nan)
    return out


if __name__ == "__main__":
    main()
