"""`python -m rhs gate BASELINE key=value ...`: did this change help?

    python -m rhs gate results/sweeps/NAME planner=my_planner            every run of the folder again, with the change
        --measure NAME    column that is compared (planning: plan_length_m; else ate_rmse_m); less is better, or
                          more where `python -m rhs help columns` says so
        --margin 0.02     a loss of this share of it is still no worse; worse is one that is sure and seems larger
        --lost 0.2        successes lost by this share of all runs are still no worse; 20 pairs of which none is lost can
                          tell 0.2, 100 can tell 0.05
        --pairs 20        at most so many pairs; it stops as soon as it is sure
        --jobs N          processes at a time (one per core)
        output=FOLDER     where the new runs go (a new folder under results/sweeps); killed, the same goes on there

Old and new run have the same world, seed and settings but for the change. Old runs that broke off (a part raised, time ran
out) count as such, as new ones do. Exit codes: 0 better or no worse, 1 worse,
2 refused, 3 needs more runs.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

from rhs.api.settings import nearest
from rhs.base.errors import ConfigError
from rhs.config.compose import config_hash, identity, overlaid
from rhs.config.dictionary import columns
from rhs.config.overrides import Word
from rhs.reports.gate import LOST, Verdict, error_parts, judge, looks
from rhs.reports.observations import of_successes
from rhs.runfolder.row import number_in
from rhs.sweeps.jobs import Job, Limits
from rhs.sweeps.kept import broken_off, kept_rows
from rhs.sweeps.runs import rows_of, values_of
from rhs.sweeps.sweep import job_of

from .arguments import JOBS, Number, going_on, limits, parse
from .progress import running
from .say import of_drawn
from .verify import made_otherwise

OLD = ("ok", "failed", "timeout", "killed")  # how a run of the baseline may have ended: not by somebody's hand
MEASURES = {"planning": "plan_length_m"}  # of the others: ate_rmse_m
QUESTION = ("task", "world", "seed", "start", "goal")  # what old and new run have in common
Row = Mapping[str, object]


def main(words: Sequence[str]) -> int:
    """The command."""
    chosen = parse("gate", __doc__, words, measure="", margin=Number(0.02, low=0.0, high=1.0),
                   lost=Number(LOST, low=0.0, high=1.0), pairs=Number(20, low=4, high=100_000), jobs=JOBS)
    change = [word for word in chosen.words if "=" in word]
    folders = [word for word in chosen.words if "=" not in word]
    if len(folders) != 1 or not change:
        raise ConfigError("gate: expected one folder of runs and a change: python -m rhs gate FOLDER planner=my_planner")
    pairs = _pairs(Path(folders[0]), change, chosen.pairs)
    measure = chosen.measure or MEASURES.get(str(pairs[0][0].get("task")), "ate_rmse_m")
    if chosen.measure or any(rank(row) == 2 for row, _ in pairs):  # else successes are all that there is to compare
        _check_measure(measure, [row for row, _ in pairs], folders[0])
    column = columns().get(measure)
    more_is_better = column is not None and column.more_is_better
    within = limits(chosen)
    with going_on(chosen.output) as folder:
        found, notes = _compared(pairs, folder, within, measure, chosen.margin, chosen.lost, more_is_better)
        content = {"measure": measure, "margin": chosen.margin, "lost_margin": chosen.lost, **asdict(found)}
        (folder / "gate.json").write_text(json.dumps(content) + "\n", encoding="utf-8")
        told = f"{measure} (more is better)" if more_is_better else measure
        sys.stdout.write("\n".join([in_words(found, told, chosen.margin), *notes, f"files: {folder}", ""]))
    return found.exit_code


def _pairs(folder: Path, change: Sequence[str], most: int) -> list[tuple[Row, Job]]:
    """(old row, new job) for the runs of the folder, all composed before any runs. Raises ConfigError."""
    if asked := [word for word in change if word.partition("=")[0] in QUESTION]:
        raise ConfigError(f"gate: {asked[0]} is another question, not a change of how it is answered; gate a folder of that")
    rows = rows_of([folder])
    old = [(row, where) for where, row in rows.items() if row.get("status") in OLD and
           (row["status"] == "ok" or not where.exists() or (where / "config.yaml").is_file())]
    old.sort(key=lambda one: (str(one[0].get("seed")).zfill(12), str(one[1])))
    if len(old) < 4:
        raise ConfigError(f"gate {folder}: {len(old)} finished runs; expected at least 4 to compare with")
    pairs: list[tuple[Row, Job]] = []
    met: dict[str, Path] = {}
    values = values_of([where for _, where in old[:most]])
    for row, where in old[:most]:
        config = overlaid(values[where], change)
        if config_hash(config) == row.get("config_hash") and identity(config)["plugins"] == (row.get("plugins") or ""):
            raise ConfigError(f"gate: {' '.join(change)} changes nothing in {where}")
        job = job_of(config, [Word("seed", config.seed, f"seed={config.seed}")], ["seed"])
        if job.name in met:
            raise ConfigError(f"gate: {' '.join(change)} makes one run of two, {met[job.name].name} and {where.name}; give "
                              "a folder with one of them")
        met[job.name] = where
        pairs.append((row, job))
    return pairs


def _check_measure(measure: str, old: Sequence[Row], folder: str) -> None:
    """Raises ConfigError for a measure that no old run has: it could never be compared."""
    if not any(math.isfinite(measured(row, measure)) for row in old):
        known = sorted({name for row in old for name in row if math.isfinite(measured(row, name))})
        raise ConfigError(f"gate --measure {measure}: no run of {folder} has such a figure{nearest(measure, known)}; "
                          f"python -m rhs table {folder} --rows shows those there are")


def _compared(pairs: Sequence[tuple[Row, Job]], folder: Path, limits: Limits, measure: str,
              margin: float, lost_margin: float, more_is_better: bool = False) -> tuple[Verdict, list[str]]:
    """Run new jobs until a look settles it, or there are no more; and what is to be said of them."""
    planned, done = looks(len(pairs)), 0
    new: list[Row] = []
    with running(len(pairs), unit="pair") as tell:
        for until, level in zip(planned, error_parts(planned), strict=True):
            new += kept_rows([job for _, job in pairs[done:until]], folder, limits, tell=tell)
            done = until
            old = [row for row, _ in pairs[:done]]
            ranks = [(rank(a), rank(b)) for a, b in zip(old, new, strict=True)]
            found = judge([measured(row, measure) for row in old], [measured(row, measure) for row in new],
                          [(before > after, after > before) for before, after in ranks], margin=margin, level=level,
                          more_is_better=more_is_better, lost_margin=lost_margin)
            if found.word != "needs more runs":
                break
    made = made_otherwise(str(old[0].get("versions") or ""), str(new[0].get("versions") or ""))
    notes = [("new runs: ", broken_off(new)), ("old runs: ", made),
             *(("new runs: ", line) for line in of_drawn([row.get("global_random") for row in new]))]
    return found, [f"{whose}{said}" for whose, said in notes if said]


def rank(row: Row) -> int:
    """2: achieved what it was asked for, 1: came to its end, 0: broke off."""
    return 0 if row.get("status") != "ok" else 2 if row.get("success") == 1.0 else 1


def measured(row: Row, measure: str) -> float:
    """The measure of a run; NaN where it broke off, and went a shorter way, and where it is that of successes alone."""
    counts = rank(row) and (row.get("success") != 0.0 or not of_successes(measure))
    return number_in(row, measure) if counts else math.nan


def in_words(found: Verdict, measure: str, margin: float) -> str:
    """One line: the verdict, the change with its interval, the successes."""
    word = f"no worse than {100 * margin:g} %" if found.word == "no worse" else found.word
    between = f"({100 * found.low:+.3g} to {100 * found.high:+.3g} %), {found.pairs} pairs"
    if found.low == found.high:
        between = f"in each of {found.pairs} pairs"
    text = f"{measure} {100 * found.change:+.3g} % {between}"
    if found.pairs < 4:
        text = f"{measure} is known in {found.pairs} pairs"
    if found.pairs == found.lost == found.won == 0:
        text = "no old and no new run did what it was asked for, nothing can be compared"
    more = f"; about {found.needed} pairs would settle it" if found.needed else ""
    if found.word != "worse" and found.pairs + found.lost + found.won:
        more = f"; that up to {100 * found.lost_at_most:.0f} % of runs lose theirs is not ruled out{more}"
    if found.low == found.high == 0.0:
        more += "; not a digit of it changed: name one that the change can move by --measure NAME"
    return f"{word}: {text}; successes lost {found.lost}, won {found.won}{more}"
