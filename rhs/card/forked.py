"""Work in a forked process, received item by item: a part that hangs, crashes or ends its process costs an item, not the
page, and its memory and time are measured alone."""

from __future__ import annotations

import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from rhs.base.processes import die_with_parent, end_unless, kill_group
from rhs.base.provenance import peak_memory_mb
from rhs.testing.checks import in_words

OF = multiprocessing.get_context("fork")
QUEUED_LEAST_S = 0.05  # less is everybody's


@dataclass
class ForkResult:
    """items: received, in order. ended: why no more came, empty when the work was done. memory_mb: most memory taken beyond
    what the process began with. cpu_s: processor time. waited_share: of its time, in which it neither computed nor stood in
    line for a processor: it slept, or waited for files, processes or the network; NaN where the system does not tell."""

    items: list[Any] = field(default_factory=list)
    ended: str = ""
    memory_mb: float = float("nan")
    cpu_s: float = float("nan")
    waited_share: float = float("nan")


def run_forked(work: Callable[[], Iterator[Any]], *, patience_s: float,
               tell: Callable[[Any], None] = lambda item: None) -> ForkResult:
    """Run `work()` in a forked process, ended when an item takes longer than patience_s, beyond what it stood in line for a
    processor. tell: called with each item."""
    with tempfile.TemporaryDirectory(prefix="rhs-", ignore_cleanup_errors=True) as scratch:  # nobody's when it is killed
        result, (ours, theirs) = ForkResult(), OF.Pipe(duplex=False)
        process = OF.Process(target=_say, args=(work, theirs, scratch), daemon=False)  # it may fork
        sys.stdout.flush()
        sys.stderr.flush()
        process.start()
        theirs.close()
        try:
            while True:
                if not _answers(ours, process.pid, patience_s):
                    result.ended = f"no answer for {patience_s:g} s"
                    break
                what, value = ours.recv()
                if what == "item":
                    result.items.append(value)
                    tell(value)
                    continue
                if what == "end":
                    result.memory_mb, result.cpu_s, result.waited_share = value
                else:
                    result.ended = value
                break
        except EOFError:
            process.join()
            result.ended = f"its process ended by itself (exit code {process.exitcode})"
        finally:
            if process.pid is not None and process.is_alive():
                kill_group(process.pid)
            process.join()
            ours.close()
        return result


def _answers(pipe: Connection, pid: int | None, patience_s: float) -> bool:
    """Whether it says something in time; of a busy machine, which keeps it waiting for a processor, it is given more."""
    begin, left_s = queued_s(pid), patience_s
    while not pipe.poll(left_s):
        waited_s = queued_s(pid) - begin
        if not waited_s > QUEUED_LEAST_S:  # or it is not known
            return False
        begin, left_s = begin + waited_s, waited_s
    return True


def _say(work: Callable[[], Iterator[Any]], pipe: Connection, scratch: str) -> None:
    die_with_parent()
    tempfile.tempdir = scratch
    process, before_mb, before_s, began_s, in_line_s = (os.getpid(), peak_memory_mb(), time.process_time(),
                                                        time.monotonic(), queued_s())

    def send(what: str, value: Any) -> None:
        end_unless(process)
        pipe.send((what, value))

    try:
        for item in work():
            send("item", item)
        cpu_s, took_s = time.process_time() - before_s, time.monotonic() - began_s
        waited_share = 1.0 - (cpu_s + queued_s() - in_line_s) / took_s
        send("end", (max(peak_memory_mb() - before_mb, 0.0), cpu_s, max(waited_share, 0.0)))
    except BaseException as error:
        send("error", in_words(error)[:300])


def queued_s(pid: int | None = None) -> float:
    """Seconds that this thread, or the main thread of that process, has stood in line for a processor; NaN where the system
    does not tell (proc, schedstat)."""
    try:
        return 1e-9 * int(Path(f"/proc/{pid or 'thread-self'}/schedstat").read_text("ascii").split()[1])
    except (OSError, ValueError, IndexError):
        return float("nan")
