"""One run at the command line: what is said of it, and the exit code."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING, Any

from rhs.base.commands import LONGEST, complain, plain, shortened, signal_code

from . import first_run
from .streams import streams_kept

if TYPE_CHECKING:
    from rhs.config.compose import RunConfig

COMPILES = "compiling inner loops that no run needed before: 10 to 60 s"


class Terminated(KeyboardInterrupt):
    """SIGTERM arrived: like Ctrl-C, with another exit code."""

    exit_code = 143


def one_run(config: RunConfig, debug: bool) -> int:
    """Run it under a progress bar, say what came of it; the exit code."""
    from rhs.api.jit import on_compile
    from rhs.base.system import processors
    from rhs.metrics.evaluate import folder_fault
    from rhs.metrics.truth_clock import clock_fault
    from rhs.patrol.observers import bar
    from rhs.patrol.run import run_config
    from rhs.runfolder.folders import claim_run

    from . import say

    on_compile(partial(_compiling, beside=config.ahead != "off" and processors() > 1))
    with claim_run(config.output, seed=config.seed, overwrite=config.overwrite) as claim:
        with streams_kept():
            row = run_config(config, claim.folder, bar)
        claim.publish()
        cause = row.pop("_cause", None)
        print(f"{say.of_run(row, claim.folder)}\n\nfiles: {claim.folder}")
    status = row.get("status")
    if drawn := row.get("global_random"):
        print(f"rhs: {drawn}'s global generator was used: {say.DRAWN}", file=sys.stderr)
    for fault in (clock_fault(row), folder_fault(claim.folder) if status == "ok" else ""):
        if fault:
            print(f"rhs: {fault}", file=sys.stderr)
    if status == "ok" and row.get("lost"):
        print(f"rhs: done with what is left of the recording: {row['lost']}", file=sys.stderr)
        return 3
    if status == "ok" and row.get("success") == 0:
        why = plain(str(row.get("plan_failure") or row.get("failure", "")))
        print(f"rhs: not achieved: {why}{_check_hint(row)}", file=sys.stderr)
        return 3
    failures = [str(row[name]) for name in ("row_failures", "metric_failures", "picture_failures") if row.get(name)]
    if status == "ok" and (failed := "; ".join(failures)):
        print(f"rhs: done, but a figure or a picture failed: {shortened(plain(str(failed)), LONGEST)}", file=sys.stderr)
        return 3
    if status == "ok":
        return 0
    code = 1 if cause is None or status != "interrupted" else signal_code(cause)
    reason = str(row.get("reason", ""))
    return complain(reason if reason.startswith(str(status)) else f"{status}: {reason}", code, cause, debug=debug)


def _check_hint(row: dict[str, Any]) -> str:
    """What to type where parts took part that are not rhs's own; empty where none did."""
    return "; does your part keep its contract? python -m rhs check [--plugin FILE] KIND=NAME" if row.get("plugins") else ""


def _compiling(beside: bool) -> None:
    """beside: whether there is a processor for it."""
    print(COMPILES, file=sys.stderr, flush=True)
    if beside:
        first_run.begin()
