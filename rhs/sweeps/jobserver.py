"""`python -m rhs.sweeps.jobserver`: runs chunks of jobs for an engine's worker, a process for each job (rhs.sweeps.jobs).

Chunks come by standard input, a line of JSON each (rhs.sweeps.chunks.Chunk); answers go to standard output: a line for
each job and `{"end": ...}`. At the end of its input it goes, and its jobs with it. What jobs print goes to their job.log.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import os
import queue
import shutil
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TextIO

from rhs.base.errors import ConfigError, EngineError, RhsError
from rhs.base.processes import descendants, kill
from rhs.config.compose import Composer
from rhs.config.loose import take_over
from rhs.config.overrides import Combinations
from rhs.runfolder.row import read_row

from .chunks import Chunk
from .jobs import Job, Limits, Outcome, asked_for, run_jobs
from .keep import line_of, refused, wanted
from .sweep import job_of
from .worker import COMPILING

LARGEST_SENT = 8 << 20  # bytes of a file that travels back with a row where no disk is shared


@dataclass
class Server:
    """What is kept from one chunk to the next."""

    answers: TextIO
    composers: dict[tuple[str, ...], Composer] = field(default_factory=dict)
    words: Combinations = field(default_factory=lambda: Combinations([]))
    scratch: str = ""

    def run(self, chunk: Chunk) -> None:
        """Run its jobs in a folder of their own and answer."""
        _check(chunk)
        take_over(chunk.plugins)
        began, spent = time.monotonic(), os.times()
        where = Path(chunk.folder) if (Path(chunk.folder) / chunk.token).is_file() else None
        with tempfile.TemporaryDirectory(prefix="rhs-jobs-", ignore_cleanup_errors=True) as scratch:
            self.scratch = scratch
            jobs = list(self._composed(chunk))

            def tell(job: Job, status: str) -> None:
                if status != COMPILING:
                    self._answer(job, Path(scratch), chunk.keep, where)

            outcome = Outcome()
            if jobs:
                outcome = run_jobs(jobs, Path(scratch), Limits(**chunk.limits), tell=tell, preload=asked_for(jobs))
        now = os.times()
        cpu_s = sum(now[:4]) - sum(spent[:4])
        self.say(json.dumps({"end": time.monotonic() - began, "cpu_s": cpu_s, "reasons": dict(outcome.reasons)}))

    def _composed(self, chunk: Chunk) -> Iterator[Job]:
        """The jobs of the chunk; one whose words do not fit each other is a row at once."""
        composer = self.composers.setdefault(tuple(chunk.conf), Composer(tuple(map(Path, chunk.conf))))
        for texts in chunk.words:
            words = self.words.words_of(texts)
            try:
                yield job_of(composer.config(words), words, chunk.swept)
            except ConfigError as error:
                self.say(refused(words, chunk.swept, error).text())

    def _answer(self, job: Job, scratch: Path, keep: str, where: Path | None) -> None:
        """The row of a job that is over, and its folder if it is wanted; the rest of it goes."""
        folder = scratch / job.name
        try:
            row = read_row(folder / "row.json")
        except RhsError:
            return  # it could not be started, or is being compiled for: no row, it is sent again
        if wanted(keep, row) and where is not None:
            _move(folder, where)
        elif wanted(keep, row):
            self.say(json.dumps({"folder": job.name, "zip": _packed(folder)}))
        shutil.rmtree(folder, ignore_errors=True)
        self.say(line_of(job, row).text())

    def say(self, text: str) -> None:
        """A line of the answer."""
        self.answers.write(text + "\n")
        self.answers.flush()


def _check(chunk: Chunk) -> None:
    """What the jobs need must be here. Raises EngineError."""
    if chunk.rhs != version("rhs"):
        raise EngineError(f"the sweep runs rhs {chunk.rhs}, the worker {version('rhs')}; install the same")
    if os.path.isdir(chunk.here):
        os.chdir(chunk.here)
    missing = [path for path in (*chunk.conf, *(one["file"] for one in chunk.plugins)) if not os.path.exists(path)]
    if missing:
        raise EngineError(f"{missing[0]} is not there where the jobs run")


def _move(folder: Path, sweep: Path) -> None:
    """Put a run folder into the sweep's, whole or not at all."""
    partial = sweep / f".{folder.name[:60]}.tmp-{os.getpid()}"
    shutil.copytree(folder, partial, dirs_exist_ok=True)
    shutil.rmtree(sweep / folder.name, ignore_errors=True)
    partial.rename(sweep / folder.name)


def _packed(folder: Path) -> str:
    """The files of a folder as a zip in text; those that are large are left out."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.stat().st_size <= LARGEST_SENT and path.name != ".lock":
                file.write(path, str(path.relative_to(folder)))
    return base64.b64encode(out.getvalue()).decode()


def main() -> None:
    """Serve until the input ends."""
    server = Server(os.fdopen(os.dup(1), "w", encoding="utf-8"))
    os.dup2(2, 1)  # what a library prints is no answer
    chunks: queue.Queue[str] = queue.Queue()

    def listen() -> None:
        for line in sys.stdin:
            chunks.put(line)
        if server.scratch:
            shutil.rmtree(server.scratch, ignore_errors=True)
        kill([*descendants(os.getpid()), os.getpid()])  # the worker is gone

    threading.Thread(target=listen, daemon=True).start()
    while True:
        with contextlib.suppress(BrokenPipeError):
            server.run(Chunk(**json.loads(chunks.get())))


if __name__ == "__main__":
    main()
