"""Patrols with a sensor worse than told: depth noise so many times a Kinect's, a camera that sways. Do stated chances hold?

    python tests/benchmarks/worse_than_told.py --buildings loop/3 office/3 --out runs/worse
    python tests/benchmarks/worse_than_told.py --buildings hall/10000 --times 0 64 --sway 3 --seed 1

One sweep for each level, of the localisers over the buildings (`world=random:FAMILY/NUMBER`); further words are those of a
run. Killed, it goes on where it stopped when the same command is given again. `reachable` as in buildings.py. wrong_sure:
share of the patrol's views wrong (0.25 m, 5 degrees) and sure. nees: squared error by stated sigmas in x, y and heading,
over three, median of the views that call themselves tracking (0.79 is honest, more is too sure); survey_nees: the same of
the survey as it was believed. within: of the tracking views, those whose nees is below its 99.7 % quantile. Writes
worse_than_told.csv beside the runs. Buildings below 10000 are for building and tuning, those from 10000 on for judging only.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from shared import write

from rhs.api.geometry import wrap
from rhs.base.provenance import commit
from rhs.runfolder.row import read_row
from rhs.worlds.world import load_world

LIMIT = 13.93 / 3.0  # chi-square of three degrees of freedom, 99.7 %


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--buildings", nargs="+", default=["loop/3", "office/3", "home/3", "hall/3"])
    parser.add_argument("--localisers", nargs="+", default=["sift_db", "particle_filter"])
    parser.add_argument("--times", nargs="*", type=float, default=[0.0, 4.0, 16.0, 64.0],
                        help="noise put on the depth, times a Kinect's; 0: the sensor as told")
    parser.add_argument("--sway", nargs="*", type=float, default=[3.0], help="pitch and roll, degrees rms")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/worse_than_told"))
    parser.add_argument("--timeout", type=float, default=900.0, help="seconds for one run")
    parser.add_argument("words", nargs="*", help="key=value words of a run")
    options = parser.parse_intermixed_args()
    levels = {f"noise_{times:g}": ["degrade=depth_noise", f"degrade.noise_times={times:g}"] if times else []
              for times in options.times}
    levels |= {f"sway_{degrees:g}": [f"source.pitch_roll_deg={degrees:g}"] for degrees in options.sway}
    found: list[dict[str, Any]] = []
    for level, words in levels.items():
        sweep(options.out / level, [f"world={','.join(f'random:{name}' for name in options.buildings)}",
                                    f"localiser={','.join(options.localisers)}", f"seed={options.seed}",
                                    *words, *options.words], options.timeout)
        found += rows(options.out / level, level)
    if not found:
        sys.stderr.write(f"no rows in {options.out}\n")
        return 1
    write(options.out / "worse_than_told.csv", found)
    sys.stdout.write("\n".join([*table(found), f"commit: {commit()}", ""]))
    return 0


def sweep(out: Path, words: list[str], timeout_s: float) -> None:
    """The runs of one level; those that are there already are kept."""
    resume = ["--resume"] if (out / "sweep.json").exists() else []
    subprocess.run([sys.executable, "-m", "rhs", "-m", *words, f"output={out}", "recording=off", "pictures=off", "--jobs=1",
                    f"--timeout={timeout_s:g}", *resume], check=False, stdout=subprocess.DEVNULL)


def rows(folder: Path, level: str) -> list[dict[str, Any]]:
    """One per run: what became of it, and whether its stated errors hold."""
    out = []
    for path in sorted(folder.glob("*/row.json")):
        row = read_row(path)
        world = load_world(str(row["world"]), seed=int(row["seed"]))
        told = path.parent / "steps.csv"  # not there where the run ended before its first view
        lines = told.read_text(encoding="utf-8").splitlines() if told.exists() else []
        steps = [step for step in csv.DictReader(lines) if step["true_x_m"]]
        patrol = [step for step in steps if step["phase"] == "patrol"]
        tracking = [step for step in patrol if step["belief_status"] == "tracking"]
        survey, believed = (nees([step for step in chosen]) for chosen in
                            ([step for step in steps if step["phase"] == "survey"][1:], tracking))
        out.append({
            "level": level, "building": str(row["world"]).removeprefix("random:"), "localiser": row["localiser"],
            "status": row["status"], "places": len(world.places),
            "reachable": np.nan if row.get("places_reachable") is None else float(row["places_reachable"]),
            "visited": row.get("places_visited"), "collisions": row.get("collisions"), "views": len(patrol),
            "tracking": len(tracking) / max(len(patrol), 1), "wrong_sure": row.get("belief_wrong_sure_share"),
            "nees": median(believed), "within": float(np.mean(believed < LIMIT)) if len(believed) else np.nan,
            "ece": row.get("belief_ece"), "patrol_rmse_m": row.get("patrol_rmse_m"),
            "survey_nees": median(survey), "ate_before_m": row.get("ate_before_closing_m"), "ate_m": row.get("ate_rmse_m"),
            "survey_sigma_m": last_sigma(steps), "map_agreement": row.get("map_agreement"),
            "why": str(row.get("cause") or row.get("reason") or "")})
    return out


def nees(steps: list[dict[str, str]]) -> np.ndarray:
    """(N,) squared error by the stated sigmas of x, y and heading, over three."""
    errors = [[float(s["x_m"]) - float(s["true_x_m"]), float(s["y_m"]) - float(s["true_y_m"]),
               float(wrap(float(s["yaw_rad"]) - float(s["true_yaw_rad"])))] for s in steps]
    sigmas = [[float(s["sigma_x_m"]), float(s["sigma_y_m"]), float(s["sigma_yaw_rad"])] for s in steps]
    out: np.ndarray = ((np.reshape(errors, (-1, 3)) / np.reshape(sigmas, (-1, 3))) ** 2).mean(axis=1)
    return out


def median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def last_sigma(steps: list[dict[str, str]]) -> float:
    """Stated error at the end of the survey as it was believed, metres."""
    last = [step for step in steps if step["phase"] == "survey"][-1:]
    return float(np.hypot(float(last[0]["sigma_x_m"]), float(last[0]["sigma_y_m"]))) if last else float("nan")


def table(found: list[dict[str, Any]]) -> list[str]:
    """Lines by level and localiser."""
    lines = [f"{'level':<10}{'localiser':<17}{'runs':>5}{'no row':>7}{'visited':>8}{'reachable':>10}{'coll.':>6}"
             f"{'wrong_sure':>11}{'worst':>7}{'tracking':>9}{'nees':>7}{'within':>7}{'ece':>6}{'ate':>7}{'agree':>7}"]
    for key in dict.fromkeys((row["level"], row["localiser"]) for row in found):
        some = [row for row in found if (row["level"], row["localiser"]) == key]
        done = [row for row in some if row["status"] == "ok"]
        total = {name: np.nansum([float(row[name]) for row in done]) for name in ("visited", "reachable", "collisions")}
        mean = {name: mean_of(done, name) for name in ("wrong_sure", "tracking", "nees", "within", "ece", "ate_m",
                                                        "map_agreement")}
        worst = max([float(row["wrong_sure"]) for row in done], default=float("nan"))
        lines.append(f"{key[0]:<10}{key[1]:<17}{len(some):>5}{len(some) - len(done):>7}{total['visited']:>8.0f}"
                     f"{total['reachable']:>10.0f}{total['collisions']:>6.0f}{mean['wrong_sure']:>11.4f}{worst:>7.3f}"
                     f"{mean['tracking']:>9.2f}{mean['nees']:>7.2f}{mean['within']:>7.2f}{mean['ece']:>6.2f}"
                     f"{mean['ate_m']:>7.3f}{mean['map_agreement']:>7.3f}")
    return [*lines, *(f"  {row['level']} {row['building']} {row['localiser']}: {row['visited']} of {row['reachable']}, "
                      f"{row['why'][:150]}" for row in found if row["why"])]


def mean_of(found: list[dict[str, Any]], name: str) -> float:
    known = [float(row[name]) for row in found if row[name] is not None and np.isfinite(float(row[name]))]
    return float(np.mean(known)) if known else float("nan")


if __name__ == "__main__":
    sys.exit(main())
