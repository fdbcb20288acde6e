"""Jobs whose rows are kept: what has ended is not run again, whoever asks and however the last asking was stopped; but where
the code of somebody's part has changed since."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rhs.base.errors import RhsError
from rhs.config.compose import identity
from rhs.runfolder.row import read_row
from rhs.runfolder.shards import Line, read_lines, shards, words_key

from .jobs import Job, Limits, asked_for, run_jobs
from .keep import Keeper
from .worker import COMPILING

ENDED = ("ok", "failed", "refused")  # by itself: another run would end alike. Time and memory are the machine's
MISSING = "missing"  # the status of a run that left no row
Row = dict[str, Any]


def kept_rows(jobs: Sequence[Job], folder: Path, limits: Limits, *, tell: Callable[[Job | str, str], None],
              keep: str = "all") -> list[Row]:
    """The row of each job, in their order; run are those that have none in the folder yet. A job that left no row has the
    status `missing`. tell(job, status): after each; of those that were there already, first and by name. keep: whose
    folders stay; of the others the rows do, in shards."""
    lines = read_lines(shards(folder), []) if keep != "all" else {}
    outcomes = {job.name: ended(job, folder, lines.get(words_key(job.words))) for job in jobs}
    found = {name: row for name, row in outcomes.items() if row is not None}
    for job in jobs:
        if job.name in found:
            tell(job.name, str(found[job.name]["status"]))
    todo = list({job.name: job for job in jobs if job.name not in found}.values())
    keeper = Keeper(folder, keep)

    def over(job: Job, status: str) -> None:
        if status != COMPILING:
            found[job.name] = any_row(folder / job.name)
            if keep != "all":
                keeper.take_folder(job)
                keeper.tick()
        tell(job, status)

    try:
        if todo:
            run_jobs(todo, folder, limits, tell=over, preload=asked_for(todo))
    finally:
        keeper.close()
    return [found.get(job.name) or any_row(folder / job.name) for job in jobs]


def broken_off(rows: Sequence[Mapping[str, Any]]) -> str:
    """How many of these runs did not come to their end, and why most of those; empty where all did."""
    whys = Counter(str(row.get("reason") or row.get("status") or MISSING) for row in rows if row.get("status") != "ok")
    return f"{whys.total()} of {len(rows)} broke off, most by: {whys.most_common(1)[0][0][:200]}" if whys else ""


def ended(job: Job, folder: Path, line: Line | None) -> Row | None:
    """The row of a job that ended by itself, from its folder or its line in a shard; None where there is none, or only one
    of other code."""
    rows = [any_row(folder / job.name), *([] if line is None else [dict(line.row)])]
    return next((row for row in rows if row["status"] in ENDED and same_code(row, job)), None)


def same_code(row: Mapping[str, Any], job: Job) -> bool:
    """Whether a row is of the plugins as they are now."""
    return (row.get("plugins") or "") == identity(job.config)["plugins"]


def any_row(folder: Path) -> Row:
    """The row of a run, however it ended; one that says so where there is none."""
    try:
        return {"status": MISSING} | read_row(folder / "row.json")
    except RhsError as error:
        return {"status": MISSING, "reason": str(error)}
