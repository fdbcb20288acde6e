"""Keeps an engine busy: chunks of jobs out, rows in, whatever dies on the way.

A chunk whose worker died is sent again; one that fails three times goes as two halves, and a job that kills its workers
alone is left without a row and named. An engine that gives nothing back but faults, or says that it is no longer alive,
ends the sweep: rows are kept, and `--resume` goes on, on this engine or another.
"""

from __future__ import annotations

import base64
import io
import itertools
import json
import logging
import math
import shutil
import time
import zipfile
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any

from rhs.api.engine import Engine
from rhs.base.errors import ContractError, EngineError, RhsError, told, where
from rhs.runfolder.folders import job_folder
from rhs.runfolder.shards import Line, parsed, words_key

from .chunks import Chunk, run_chunk
from .ending import GRACE_S, shortfall
from .job import Outcome, alike
from .keep import Keeper, wanted

log = logging.getLogger("rhs")
FIRST_JOB_S = 30.0  # a job is taken to last so long until some were measured
MOST_IN_A_CHUNK = 1000
TRIES = 3  # of a chunk, before it goes as two halves
SLACK_S = 120.0  # of a chunk beside its jobs' own limits: starting a job server, compiling
GROWS = 4  # a chunk has at most so many times the jobs of the largest that came back


def check_engine(engine: Engine) -> Engine:
    """The engine, if its numbers can be. Raises ContractError."""
    for name, least in (("width", 1), ("processes", 1), ("chunk_s", 0.0)):
        value = getattr(engine, name)
        if isinstance(value, bool) or not isinstance(value, Real) or not least <= float(value) < math.inf:
            raise ContractError(f"{name} is {value!r}; expected a number, {least:g} or more")
    return engine


@dataclass
class Part:
    """Jobs that are sent together, and what became of the attempts."""

    words: list[list[str]]
    tries: int = 0
    sent: float = 0.0
    running: bool = False


@dataclass
class Driver:
    """One sweep on one engine. chunk: what all chunks have in common. same_failures: as in Limits. told(status): after each
    row; "" when time has passed. Call `run` once."""

    engine: Engine
    chunk: Chunk
    keeper: Keeper
    outcome: Outcome
    told: Callable[[str], None]
    same_failures: int = 0
    seen: set[str] = field(default_factory=set)  # configurations that have a row
    repeated: int = 0
    total: int = 0  # jobs to come, to share them out at the end
    _out: dict[Future[str], Part] = field(default_factory=dict)
    _again: deque[Part] = field(default_factory=deque)
    _faults: int = 0  # since a chunk last came back
    _fault: str = ""
    _job_s: float = 0.0
    _largest: int = 0
    _sent: int = 0

    def run(self, coming: Iterator[list[str]]) -> None:
        """All jobs, given as their words. Raises EngineError; after it, or Ctrl-C, nothing of the engine is left."""
        try:
            executor = self.engine.open()
            if not callable(getattr(executor, "submit", None)):
                raise EngineError(f"open() returned {type(executor).__name__}; expected a concurrent.futures.Executor")
            while self._fill(executor, coming) or self._out:
                self._wait()
                self.outcome.stopped = self.outcome.stopped or alike(self.outcome, self.same_failures)
        except BaseException as error:
            self._close(now=True)
            if isinstance(error, RhsError | KeyboardInterrupt):
                raise
            raise EngineError(f"{told(error)[:300]}{where(error)}") from error
        self._close(now=False)

    def _close(self, now: bool) -> None:
        """What goes wrong here costs no row, and hides nothing that went wrong before."""
        for future in self._out:
            future.cancel()
        try:
            self.engine.close(now=now)
        except (Exception, SystemExit) as error:
            log.warning("rhs: the engine could not be closed: %s", told(error)[:300])

    def _fill(self, executor: Executor, coming: Iterator[list[str]]) -> bool:
        """Keep twice as many chunks out as can run; whether there are any."""
        while len(self._out) < 2 * self.engine.width and not self.outcome.stopped:
            part = self._again.popleft() if self._again else self._next(coming)
            if part is None:
                break
            part.sent, part.running = time.monotonic(), False
            future = executor.submit(run_chunk, replace(self.chunk, words=part.words).text())
            if not isinstance(future, Future):
                raise EngineError(f"submit() returned {type(future).__name__}; expected a concurrent.futures.Future")
            self._out[future] = part
        return bool(self._out)

    def _next(self, coming: Iterator[list[str]]) -> Part | None:
        """As many jobs as last `chunk_s`, fewer towards the end so that no worker is left without."""
        each_s = (self._job_s or FIRST_JOB_S) / self.engine.processes
        count = min(self.engine.chunk_s / each_s, MOST_IN_A_CHUNK, max(1, self.total - self._sent) / self.engine.width)
        if self._largest:
            count = min(count, GROWS * self._largest)
        words = list(itertools.islice(coming, max(1, math.ceil(count))))
        self._sent += len(words)
        return Part(words) if words else None

    def _wait(self) -> None:
        """Take in what has come. `done` is asked of every chunk: some engines cancel without waking who waits."""
        wait(self._out, timeout=1.0, return_when=FIRST_COMPLETED)
        for future in [one for one in self._out if one.done()]:
            part = self._out.pop(future)
            try:
                self._take(part, future.result())
            except (Exception, CancelledError) as error:
                self._failed(part, error)
        self.outcome.workers = self.engine.workers()
        if not self.engine.alive():
            raise EngineError("it no longer answers: what hands out its work is gone")
        for future in [one for one, part in self._out.items() if self._overdue(one, part)]:
            future.cancel()
            self._failed(self._out.pop(future), EngineError("a chunk was not heard of for longer than its jobs may take"))
        self.keeper.tick()
        self.told("")

    def _overdue(self, future: Future[str], part: Part) -> bool:
        """Whether a chunk is out for longer than it may; one that waits in a queue is not, nor one behind another."""
        now = time.monotonic()
        if self.outcome.workers == 0 or (future.running() and not part.running):
            part.sent, part.running = now, future.running()
        each_s = self.chunk.limits["timeout_s"] + GRACE_S
        most_s = len(part.words) * each_s / self.engine.processes + each_s + SLACK_S
        return bool(self.chunk.limits["timeout_s"]) and now - part.sent > most_s * (1 if part.running else 2)

    def _failed(self, part: Part, error: BaseException) -> None:
        """A chunk came back without rows."""
        part.tries += 1
        self._faults += 1
        self._fault = told(error)[:200]
        if self._faults > TRIES * self.engine.width + TRIES:
            raise EngineError(f"{self._fault} ({self._faults} times)") from error
        if part.tries < TRIES:
            self._again.append(part)
        elif len(part.words) > 1:
            half = len(part.words) // 2
            self._again.extend([Part(part.words[:half]), Part(part.words[half:])])
        else:
            name = " ".join(part.words[0])[-120:]
            self.outcome.count(name, "skipped", f"{self._fault}: given up after {TRIES} tries: {name}")
            self.told("skipped")

    def _take(self, part: Part, answer: str) -> None:
        """The rows of a chunk. Jobs that it says nothing of are sent again."""
        if not isinstance(answer, str):
            raise EngineError(f"a chunk was answered by {type(answer).__name__}; expected its function's text")
        missing = {words_key(words): words for words in part.words}
        took_s = 0.0
        for text in answer.splitlines():
            if text.startswith('{"folder"'):
                self._unpack(json.loads(text))
            elif text.startswith('{"end"'):
                took_s = float(json.loads(text)["end"])
            else:
                line = parsed(text)
                if missing.pop(line.words, None) is not None:
                    self._count(line, text)
        came = len(part.words) - len(missing)
        if missing:
            self._failed(replace(part, words=list(missing.values())), EngineError("a job gave no row"))
        if came:
            self._faults = 0
            each_s = took_s * self.engine.processes / len(part.words)
            self._job_s = 0.5 * (self._job_s + each_s) if self._job_s else each_s
            self._largest = max(self._largest, came)

    def _count(self, line: Line, text: str) -> None:
        """A row that is new."""
        config = str(line.row.get("config_hash") or line.words)
        if config in self.seen:
            self.repeated += 1
            return
        self.seen.add(config)
        self.keeper.take(text)
        if not wanted(self.chunk.keep, line.row):  # a folder of that name was left by a sweep that was killed here
            shutil.rmtree(job_folder(Path(self.chunk.folder), line.run), ignore_errors=True)
        status = str(line.row["status"])
        self.outcome.count(line.run, status, shortfall(line.row) if status == "ok" else str(line.row.get("reason") or ""))
        self.told(status)

    def _unpack(self, sent: dict[str, Any]) -> None:
        """A folder that came with its row, where no disk is shared."""
        folder = job_folder(Path(self.chunk.folder), str(sent["folder"]))
        partial = folder.parent / f".{folder.name[:60]}.tmp"
        shutil.rmtree(partial, ignore_errors=True)
        with zipfile.ZipFile(io.BytesIO(base64.b64decode(sent["zip"]))) as file:
            file.extractall(partial)
        shutil.rmtree(folder, ignore_errors=True)
        partial.rename(folder)
