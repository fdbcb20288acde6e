"""One run at the command line: what is said of it, and the exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.base.commands import LONGEST, complain, plain, shortened, signal_code
from rhs.base.processes import kill_strays, resident_bytes
from rhs.base.system import processors

from . import first_run
from .streams import streams_kept

if TYPE_CHECKING:
    from rhs.config.compose import RunConfig

LOOK_S, GRACE_S = 0.2, 10.0  # between two looks at a limit; for a run that was told to stop to write down what it has
LEAVE = os._exit  # as it is: while a run goes on, another stands there that takes it for a part's
COMPILES = "compiling inner loops that no run needed before: 10 to 60 s"


class Terminated(KeyboardInterrupt):
    """SIGTERM arrived: like Ctrl-C, with another exit code."""

    exit_code = 143


class RunLimits:
    """The limits of one run, looked at beside it: one that is over is told to stop, as by SIGTERM, and has GRACE_S to do so;
    then its process ends, and its row says why. What holds Python's own lock for ever (a loop in foreign code) holds these
    too: a job of a sweep, in a process of its own, does not. timeout_s, memory_mb: 0 for none."""

    def __init__(self, folder: Path, timeout_s: float, memory_mb: float) -> None:
        self.folder, self.timeout_s, self.memory_mb = folder, timeout_s, memory_mb
        self.over: tuple[str, str] | None = None  # status and reason
        self._done = threading.Event()

    def __enter__(self) -> RunLimits:
        if self.timeout_s or self.memory_mb:
            threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()

    def _watch(self) -> None:
        began = time.monotonic()
        while not self._done.wait(LOOK_S):
            if self.timeout_s and time.monotonic() - began > self.timeout_s:
                self.over = "timeout", f"took longer than the {self.timeout_s:g} s of --timeout"
            elif self.memory_mb and resident_bytes(os.getpid()) > 2**20 * self.memory_mb:
                self.over = "killed", f"took more memory than the {self.memory_mb:g} MB of --memory-mb"
            if self.over is not None:
                break
        else:
            return
        os.kill(os.getpid(), signal.SIGTERM)
        if not self._done.wait(GRACE_S):
            self.end()

    def end(self) -> None:
        """End the process of a run that does not listen, and all that it started."""
        from rhs.runfolder.row import read_row

        row = self.told(read_row(self.folder / "row.json") | {"status": "interrupted", "reason": ""})
        complain(f"{row['status']}: {row['reason']}; files: {self.folder}", 1)
        kill_strays(os.getpid())
        LEAVE(1)

    def told(self, row: dict[str, Any]) -> dict[str, Any]:
        """The row, which says of a run that was stopped for its limits so; written too."""
        from rhs.metrics.success import with_success
        from rhs.runfolder.row import sound, write_row

        if self.over is None or row.get("status") != "interrupted":
            return row
        status, reason = self.over
        where = str(row.get("reason", "")).removeprefix("interrupted")
        row = {name: value for name, value in row.items() if name not in ("pid", "started")}
        row = with_success(row | {"status": status, "reason": f"{reason}{where}"})
        write_row(self.folder, sound({name: value for name, value in row.items() if name != "_cause"}))
        return row


def one_run(config: RunConfig, debug: bool, timeout_s: float = 0.0, memory_mb: float = 0.0) -> int:
    """Run it under a progress bar, say what came of it; the exit code. timeout_s, memory_mb: 0 for no limit."""
    from rhs.api.jit import on_compile
    from rhs.metrics.evaluate import folder_fault
    from rhs.metrics.truth_clock import clock_fault
    from rhs.patrol.observers import bar
    from rhs.patrol.run import run_config
    from rhs.runfolder.folders import claim_run

    from . import say

    on_compile(partial(_compiling, beside=config.ahead != "off" and processors() > 1))
    with claim_run(config.output, seed=config.seed, overwrite=config.overwrite) as claim:
        with streams_kept(), RunLimits(claim.folder, timeout_s, memory_mb) as within:
            row = run_config(config, claim.folder, bar)
        row = within.told(row)
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
        hint = "; does your part keep its contract? python -m rhs check [--plugin FILE] KIND=NAME"
        print(f"rhs: not achieved: {why}{hint if row.get('plugins') else ''}", file=sys.stderr)
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


def _compiling(beside: bool) -> None:
    """beside: whether there is a processor for it."""
    print(COMPILES, file=sys.stderr, flush=True)
    if beside:
        first_run.begin()
