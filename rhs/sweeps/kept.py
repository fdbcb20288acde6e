"""Jobs whose rows are kept: what has ended is not run again, whoever asks and however the last asking was stopped."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rhs.base.errors import RhsError
from rhs.runfolder.row import read_row

from .jobs import Job, Limits, asked_for, run_jobs

ENDED = ("ok", "failed", "refused")  # by itself: another run would end alike. Time and memory are the machine's
MISSING = "missing"  # the status of a run that left no row
Row = dict[str, Any]


def kept_rows(jobs: Sequence[Job], folder: Path, limits: Limits, *, tell: Callable[[Job, str], None]) -> list[Row]:
    """The row of each job, in their order; run are those that have none in the folder yet. A job that left no row has the
    status `missing`. tell(job, status): after each, those that were there already first."""
    found = {job.name: row for job in jobs if (row := ended_row(folder / job.name)) is not None}
    for job in jobs:
        if job.name in found:
            tell(job, str(found[job.name]["status"]))
    todo = [job for job in jobs if job.name not in found]
    if todo:
        run_jobs(todo, folder, limits, tell=tell, preload=asked_for(todo))
    return [found.get(job.name) or any_row(folder / job.name) for job in jobs]


def ended_row(folder: Path) -> Row | None:
    """The row of a run that ended by itself; None of any other, and where there is none."""
    row = any_row(folder)
    return row if row["status"] in ENDED else None


def any_row(folder: Path) -> Row:
    """The row of a run, however it ended; one that says so where there is none."""
    try:
        return {"status": MISSING} | read_row(folder / "row.json")
    except RhsError as error:
        return {"status": MISSING, "reason": str(error)}
