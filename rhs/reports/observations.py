"""What counts in a table: which runs succeeded, which are independent of one another, which answer the same problem.

A failed plan has no figures, whatever its row says: an invalid path is no path. Scores that hold for failures too stand
beside the figures: `spl`, success weighted by path length (Anderson et al. 2018: S * optimum / max(length, optimum)), and
`par2_ms`, the time to the first answer with failures at twice the limit, here the longest that any run of the problem took
(PAR-2 of the SAT competitions).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rhs.base.commands import shortened
from rhs.base.errors import ConfigError
from rhs.metrics.success import success_of
from rhs.runfolder.row import CHOICES, machine_dependent
from rhs.worlds.random.names import building_of, is_random

from .varied_settings import is_setting

if TYPE_CHECKING:
    import pandas

BUCKET_CELLS = 4.0  # MovingAI: bucket k holds the problems whose optimum lies in [4 k, 4 k + 4) cells
QUESTION = ("start", "goal", "planning.scenario")
ASKED = ("status", "reason", "task", "plan_success", "plan_valid", "plan_reason", "places_total", "places_reachable",
         "places_undecided", "places_visited", "tracked_share", "strips_registered_share")
# errors along a way: of a run that broke off they are those of a shorter way than the others went
OF_THE_WHOLE_WAY = ("ate_", "rpe_", "end_error_", "half_error_", "drift_", "patrol_rmse_", "localise_rmse_", "relations_",
                    "revisits_")
KEPT_OF_FAILURES = ("plan_success", "plan_valid", "plan_optimal_m")


def numbers(table: pandas.DataFrame, name: str) -> np.ndarray:
    """(N,) floats of a column; NaN where it is unknown, no number, or not there at all."""
    import pandas as pd

    if name not in table.columns:
        return np.full(len(table), np.nan)
    return pd.to_numeric(table[name], errors="coerce").astype("float64").to_numpy(dtype=float, na_value=np.nan)


def succeeded(table: pandas.DataFrame) -> np.ndarray:
    """(N,) 1.0, 0.0, or NaN where nothing was asked: the column `success`, computed for rows that have none."""
    found = numbers(table, "success")
    if np.isfinite(found).all():
        return found
    computed = np.array([success for success, _ in _outcomes(table)])
    return np.where(np.isfinite(found), found, computed)


def reasons(table: pandas.DataFrame) -> list[str]:
    """Why each run failed; empty for those that did not."""
    written = table["failure"].fillna("").tolist() if "failure" in table.columns else [""] * len(table)
    failed = succeeded(table) == 0.0
    untold = np.array([bad and not word for word, bad in zip(written, failed, strict=True)], bool)
    whys = iter(_outcomes(table[untold]))
    return [next(whys)[1] if why else word if bad else "" for word, bad, why in zip(written, failed, untold, strict=True)]


def _outcomes(table: pandas.DataFrame) -> list[tuple[float, str]]:
    return [success_of(row) for row in table[[name for name in ASKED if name in table.columns]].to_dict("records")]


def judged(table: pandas.DataFrame) -> pandas.DataFrame:
    """The table with scores, and without the figures of paths that were not found, are invalid, or end half-way."""
    done = succeeded(table)
    bucket = np.floor(numbers(table, "octile_claimed_m") / BUCKET_CELLS)
    out = table.assign(success=done, spl=_spl(table, done), bucket=bucket)
    if planned(table).any():
        out = out.assign(par2_ms=_par2_ms(table, done))
    empty = [name for name in ("spl", "bucket") if not out[name].notna().any()]
    failed = done == 0.0
    for name in out.columns if failed.any() else ():
        if of_successes(name):
            if out[name].dtype.kind in "fiu":
                out[name] = out[name].astype("Float64").mask(failed).astype("float64")
    broken_off = table["status"] != "ok" if "status" in table.columns else np.zeros(len(table), bool)
    for name in out.columns if broken_off.any() else ():
        if name.startswith(OF_THE_WHOLE_WAY) and out[name].dtype.kind in "fiu":
            out[name] = out[name].astype("float64").mask(broken_off)
    if "plan_success" in out.columns and planned(table).any():
        out["plan_success"] = out["plan_success"].mask(failed & planned(table), 0)
    return out.drop(columns=empty)


def of_successes(name: str) -> bool:
    """Whether a column says nothing of a run that failed: the length of a way that leads through a wall, or half-way."""
    return name == "path_length_m" or (name.startswith("plan_") and name not in KEPT_OF_FAILURES)


def planned(table: pandas.DataFrame) -> np.ndarray:
    """(N,) bool: rows of the planning task."""
    asked = np.isfinite(numbers(table, "plan_success"))
    return asked | (table["task"].fillna("").to_numpy() == "planning") if "task" in table.columns else asked


def _spl(table: pandas.DataFrame, done: np.ndarray) -> np.ndarray:
    plan = planned(table)
    length = np.where(plan, numbers(table, "plan_length_m"), numbers(table, "path_length_m"))
    optimum = np.where(plan, numbers(table, "plan_optimal_m"), numbers(table, "path_optimal_m"))
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(length == optimum, 1.0, optimum / np.maximum(length, optimum))
    asked = plan | np.isfinite(numbers(table, "path_length_m"))
    return np.where(done == 0.0, np.where(asked, 0.0, np.nan), np.where(done == 1.0, share, np.nan))


def _par2_ms(table: pandas.DataFrame, done: np.ndarray) -> np.ndarray:
    import pandas as pd

    took = numbers(table, "plan_ms")  # of the first answer, learning included
    limit = pd.Series(took).groupby([buildings(table), problems(table)]).transform("max").to_numpy()
    return np.where(planned(table), np.where(done == 1.0, took, 2.0 * limit), np.nan)


def problems(table: pandas.DataFrame) -> np.ndarray:
    """(N,) words for the question that a run was asked, where more than one was: scenario, start, goal."""
    return _words(table, [name for name in QUESTION if name in table.columns])


def _chosen(table: pandas.DataFrame) -> list[str]:
    """The columns that say what was chosen."""
    return [*(name for name in CHOICES if name in table.columns), *(name for name in table.columns if is_setting(name))]


def _words(table: pandas.DataFrame, names: Sequence[str]) -> np.ndarray:
    """(N,) text `name=value, ...` of the columns that are known in a row."""
    if not names:
        return np.full(len(table), "", dtype=object)
    label, first = _alike(table, names)
    columns = [[f"{name.rpartition('.')[2]}={value}" if known else "" for value, known in
                zip(table[name].iloc[first], table[name].iloc[first].notna(), strict=True)] for name in names]
    return np.array([", ".join(filter(None, row)) for row in zip(*columns, strict=True)], dtype=object)[label]


def _alike(table: pandas.DataFrame, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """(N,) numbers, the same for rows that are alike in the columns, and (G,) the first row of each number."""
    import pandas as pd

    label = np.zeros(len(table), int)
    for name in names:
        codes = pd.factorize(table[name])[0] + 1
        label = pd.factorize(label * (int(codes.max(initial=0)) + 1) + codes)[0]
    return label, np.unique(label, return_index=True)[1]


def independent(table: pandas.DataFrame) -> np.ndarray:
    """(N,) labels; runs that share one are one result: a configuration that gave the same row for every seed drew no
    random number that mattered, and a run that was done twice, in two sweeps, is one."""
    import pandas as pd

    apart = {"seed", "config_hash", *(name for name in table.columns if machine_dependent(name))}
    chosen, first = _alike(table, _chosen(table))
    same = np.ones(len(first), bool)  # configurations whose rows are all like their first
    for name in (name for name in table.columns if name not in apart):
        codes = pd.factorize(table[name])[0]
        same[chosen[codes != codes[first][chosen]]] = False
        if not same.any():
            break
    own = _alike(table, ["config_hash"]) if "config_hash" in table.columns and table["config_hash"].notna().all() else None
    return np.where(same[chosen], first[chosen], np.arange(len(table)) if own is None else own[1][own[0]])


def buildings(table: pandas.DataFrame) -> np.ndarray:
    """(N,) the world of each run; of a drawn one, whose number is the run's seed, with that number."""
    worlds = table["world"].astype("string").fillna("")
    drawn = {world for world in worlds.unique() if is_random(world)}
    if not drawn or "seed" not in table.columns:
        return worlds.to_numpy(dtype=object)
    return np.array([building_of(world, seed) if world in drawn else world
                     for world, seed in zip(worlds, table["seed"], strict=True)], dtype=object)


def clusters(table: pandas.DataFrame, by: str = "") -> np.ndarray:
    """(N,) labels of what the runs are samples of: the column `by`; or else their worlds where there are several, their
    problems where there are several, the independent ones among them otherwise (also for by="run"). Each drawn building is a
    world of its own, although their rows say `random:FAMILY`."""
    known = table["independent_"].to_numpy() if "independent_" in table.columns else None
    if by == "run":
        return independent(table) if known is None else known
    if by:
        if by not in table.columns:
            raise ConfigError(f"--cluster {by}: no such column; give world, run, or another column of the table")
        return buildings(table) if by == "world" else table[by].astype("string").fillna("").to_numpy(dtype=object)
    for label in (buildings(table), problems(table)):
        if 1 < len(set(label)):
            return label
    return clusters(table, "run")


def failures_told(table: pandas.DataFrame) -> str:
    """`3 of 6 failed: 2 x budget_spent, 1 x 1 of 4 places`."""
    asked, failed = int(np.isfinite(succeeded(table)).sum()), int((succeeded(table) == 0.0).sum())
    if not failed:
        return f"0 of {asked} failed" if asked else f"{len(table)} runs, none of them asked for anything that can fail"
    told = (shortened(word, 100) for word in reasons(table) if word)
    counts = sorted(Counter(told).items(), key=lambda item: (-item[1], item[0]))
    listed = ", ".join(f"{count} x {word}" for word, count in counts[:5])
    return f"{failed} of {asked} failed: {listed}" + (f", and {len(counts) - 5} other reasons" if len(counts) > 5 else "")
