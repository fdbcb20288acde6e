"""Where the jobs of a sweep run: a plugin that hands out a `concurrent.futures.Executor` (entry point group `rhs.engine`).

    python -m rhs -m ... engine=NAME engine.SETTING=VALUE

The sweep sends chunks of jobs, as many as last `chunk_s`, and keeps twice `width` of them out. A chunk is one call of one
importable function with one text, whose answer is one text, so that any executor which can call a function elsewhere will
do; rhs, in the version that sweeps, must be installed there. Isolation, memory and time limits of jobs come from rhs's own
job server, which that function starts beside the engine's worker: an engine needs none of them. Whatever goes wrong with an
engine is a fault of the engine (`EngineError`) and never a row.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

HERE = "here"  # provided by the engine whose jobs are started by the sweep's own process


@dataclass(frozen=True)
class EngineContext:
    """All that `build` of an engine gets. jobs: how many may run at a time (--jobs). folder: of the sweep; what an engine
    writes there begins with a dot."""

    jobs: int
    folder: Path


class Engine(Protocol):
    """Runs chunks of jobs. A class that derives from Engine has the defaults below.

    width: chunks that can run at a time. chunk_s: seconds of work wanted in one. processes: jobs at a time in a chunk."""

    width: int
    chunk_s: float = 30.0
    processes: int = 1

    def open(self) -> Executor:
        """An executor that is ready for `submit(function, text)`. Called once; may raise anything."""
        raise NotImplementedError

    def alive(self) -> bool:
        """False when what hands out the work (a scheduler) is gone: the sweep stops, keeps what it has and says so."""
        return True

    def workers(self) -> int | None:
        """Workers alive, None when nobody knows. At 0, as in a queue, no chunk counts as overdue."""
        return None

    def close(self, now: bool) -> None:
        """The end. now: by Ctrl-C or after a fault: cancel, wait for nothing, leave no process behind."""


class EngineSettings(Protocol):
    """The dataclass an entry point in `rhs.engine` names; its settings are typed as `engine.NAME=VALUE`."""

    needs: ClassVar[frozenset[str]]
    provides: ClassVar[frozenset[str]]

    def build(self, context: EngineContext) -> Engine: ...
