"""The row of a task that is one piece of work: planning alone, single places, unrolling (level 5)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rhs.base.memory import keep_freed_memory
from rhs.base.provenance import commit, versions
from rhs.config.compose import RunConfig, write_config
from rhs.runfolder.row import write_row


def run_task(row: dict[str, Any], config: RunConfig, folder: Path, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Do the work, whose columns join those of the row that say what it is.

    The configuration and the row are written whatever becomes of it. Returns the row; the exception that ended the
    work, or None, stands there under `_cause`, which is not written.
    """
    keep_freed_memory()
    begin = time.perf_counter()
    cause: BaseException | None = None
    write_config(config, folder)
    row = {"status": "ok", "reason": "", **row, "commit": commit(), "versions": versions()}
    try:
        row.update(work())
    except KeyboardInterrupt as error:
        row.update(status="interrupted", reason="interrupted by the user")
        cause = error
    except (Exception, SystemExit) as error:  # a plugin may raise anything, even exit; its run is a row with a reason
        row.update(status="failed", reason=" ".join(f"{type(error).__name__}: {error}".split()))
        cause = error
    row["wall_ms"] = 1e3 * (time.perf_counter() - begin)
    write_row(folder, row)
    return row | {"_cause": cause}
