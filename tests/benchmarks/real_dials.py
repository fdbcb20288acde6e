"""Break points of real dials: 40 runs whose levels are chosen as they come in, against a grid of 300 runs.

    python tests/benchmarks/real_dials.py [DIAL ...] [--searches 10] [--runs 10] [--jobs 2]

DIAL: those of DIALS below (all). Of each the grid is 30 levels of --runs runs (10), spread as `rhs break` spreads them
(over the logarithm where the ends lie far apart), each run with a seed of its own: what fails at a level with one seed
mostly fails beyond it too. Its 50 % level is the maximum of the likelihood of a logistic curve with lapses (SciPy), which
shares nothing with the search. Then so many searches of 40 runs, with seeds of their own. A row each: the grid's level
with its 95 % interval (bootstrap over its runs), the search's, their difference as a share of the dial, and whether that
is at most 5 %. `most`: the share of searches that can be so close on this dial at best, whatever the method: forty runs
all at the right level know a logistic curve's threshold to 2 slope / sqrt(40) (Cramer and Rao), beside the grid's own
doubt. Writes results/tables/real_dials.csv.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import norm
from shared import write

from rhs.base.provenance import commit
from rhs.config.compose import read_values
from rhs.metrics.threshold import Dial, dial_between
from rhs.runfolder.row import read_row

SURVEY = ("task=survey", "world=square_small", "odometry=procrustes", "source.image_width=160", "recording=off",
          "pictures=off")
MILESTONES = dial_between("planner.milestones", 5, 200, True), ("task=planning", "planner=prm", "planner.growth_rounds=0")
ITERATIONS = dial_between("planner.iterations", 10, 3000, True), ("task=planning",)
DIALS = {
    "milestones": (MILESTONES[0], (*MILESTONES[1], "world=map1")),
    "milestones_map3": (MILESTONES[0], (*MILESTONES[1], "world=map3")),
    "milestones_map4": (MILESTONES[0], (*MILESTONES[1], "world=map4")),
    "iterations": (ITERATIONS[0], (*ITERATIONS[1], "planner=rrt", "world=map1")),
    "iterations_map4": (ITERATIONS[0], (*ITERATIONS[1], "planner=rrt", "world=map4")),
    "iterations_connect": (ITERATIONS[0], (*ITERATIONS[1], "planner=rrt_connect", "world=map1")),
    "dark": (dial_between("degrade.dark_share", 0.0, 0.95), SURVEY),
}
LEVELS, FIRST_GRID_SEED = 30, 5000
CLOSE, SEARCH = 0.05, 40
NAMES = ("dial", "search", "grid_runs", "grid", "grid_low", "grid_high", "found", "off_share", "close", "most", "says",
         "commit")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dials", nargs="*", default=list(DIALS), choices=list(DIALS))
    parser.add_argument("--searches", type=int, default=10)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/tables/real_dials.csv"))
    chosen, rows = parser.parse_args(), []
    for name in chosen.dials:
        dial, words = DIALS[name]
        with tempfile.TemporaryDirectory() as folder:
            levels, successes = grid(Path(folder) / "grid", dial, words, chosen.runs, chosen.jobs)
            (middle, slope), several = half_level(levels, successes), bootstrap(levels, successes)
            told_of_grid = [dial.value(level) for level in (middle, *np.quantile(several, [0.025, 0.975]))]
            most = best_share(slope, float(several.std()))
            for number in range(chosen.searches):
                own = (*words, f"seed={100 * number}")
                told = search(Path(folder) / f"search_{number}", dial, own, chosen.jobs)
                off = abs(dial.level(told["middle"]) - middle)
                values = (name, number, len(levels), *told_of_grid, told["middle"], off, float(off <= CLOSE), most,
                          told["says"], commit())
                rows.append(dict(zip(NAMES, values, strict=True)))
                print(*(f"{value:.4g}" if isinstance(value, float) else value for value in values), flush=True)
    write(chosen.out, rows)
    for key in dict.fromkeys(row["dial"] for row in rows):
        mine = [row for row in rows if row["dial"] == key]
        print(f"{key}: {sum(row['close'] for row in mine):.0f} of {len(mine)} within {CLOSE:.0%} of the dial, "
              f"median {np.median([row['off_share'] for row in mine]):.1%}; at best {mine[0]['most']:.0%}")


def grid(folder: Path, dial: Dial, words: tuple[str, ...], runs: int, jobs: int) -> tuple[np.ndarray, np.ndarray]:
    """(N,) levels, shares of the dial, and (N,) bool successes of a sweep over the whole of it."""
    values = [dial.value(level) for level in np.repeat(np.linspace(0.0, 1.0, LEVELS), runs)]
    seeds = ",".join(str(FIRST_GRID_SEED + k) for k in range(len(values)))
    called("-m", f"zip({dial.key}={','.join(map(str, values))} seed={seeds})", *words, f"output={folder}", "keep=all",
           "--jobs", str(jobs))
    folders = sorted(path.parent for path in folder.glob("*/row.json"))
    assert len(folders) == LEVELS * runs, f"{len(folders)} runs in {folder}, {LEVELS * runs} asked"
    kind, _, setting = dial.key.partition(".")
    levels = [dial.level(read_values(one)[kind][setting]) for one in folders]
    return np.array(levels), np.array([read_row(one / "row.json")["success"] == 1.0 for one in folders])


def search(folder: Path, dial: Dial, words: tuple[str, ...], jobs: int) -> dict[str, Any]:
    """What `rhs break` says after 40 runs."""
    called("break", f"{dial.key}={dial.low}..{dial.high}", *words, f"output={folder}", "--jobs", str(jobs))
    told: dict[str, Any] = json.loads((folder / "break.json").read_text(encoding="utf-8"))[0]
    return told


def called(*words: str) -> None:
    """`python -m rhs ...`; exit 3 is a sweep in which something failed, which is what a dial is for."""
    done = subprocess.run([sys.executable, "-m", "rhs", *words], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        raise SystemExit(f"{' '.join(words)}: exit {done.returncode}\n{done.stderr}")


def half_level(levels: np.ndarray, successes: np.ndarray) -> tuple[float, float]:
    """(level of one half, slope) of the logistic curve, lapses aside, that makes these outcomes most likely; shares of the
    dial."""

    def unlikely(p: np.ndarray) -> float:
        lapse = 0.1 * expit(p[2])
        chance = np.clip(lapse + (1.0 - 2.0 * lapse) * expit(p[1] * (levels - p[0])), 1e-300, 1.0 - 1e-16)
        return -float(np.log(np.where(successes, chance, 1.0 - chance)).sum())

    starts = [(middle, slope, -3.0) for middle in np.linspace(0.1, 0.9, 5) for slope in (-20.0, 20.0)]
    found = [minimize(unlikely, start, method="Nelder-Mead") for start in starts]
    middle, steep, _ = min(found, key=lambda one: one.fun).x
    return float(middle), 1.0 / abs(float(steep))


def bootstrap(levels: np.ndarray, successes: np.ndarray, times: int = 100) -> np.ndarray:
    """(times,) the level of one half, runs drawn anew."""
    rng = np.random.default_rng(0)
    picks = (rng.integers(0, len(levels), len(levels)) for _ in range(times))
    return np.array([half_level(levels[pick], successes[pick])[0] for pick in picks])


def best_share(slope: float, doubt: float) -> float:
    """Share of unbiased searches within CLOSE of a level known to `doubt`, both in shares of the dial (Cramer and Rao)."""
    spread = float(np.hypot(2.0 * slope / np.sqrt(SEARCH), doubt))
    return float(2.0 * norm.cdf(CLOSE / spread) - 1.0)


if __name__ == "__main__":
    main()
