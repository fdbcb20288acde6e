"""A chunk of jobs on its way: what an engine is sent, and what it does with it.

`run_chunk` is all that an engine ever runs. It hands the chunk to a job server (rhs.sweeps.jobserver), a clean process
beside the engine's worker that is kept for the next chunk, and gives back what that says. A job server that dies is an
EngineError and never a row.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

from rhs.base.errors import EngineError


@dataclass(frozen=True)
class Chunk:
    """words: of each job, as typed. swept: the keys that the sweep varies. limits: fields of rhs.sweeps.jobs.Limits, jobs
    among them. keep: whose folders stay. folder, token: of the sweep, where its disk is shared: a file named so is there.
    here: the folder that the sweep was started in."""

    words: list[list[str]]
    swept: list[str]
    limits: dict[str, Any]
    keep: str
    folder: str
    token: str
    here: str
    conf: list[str] = field(default_factory=list)
    plugins: list[dict[str, str]] = field(default_factory=list)
    rhs: str = field(default_factory=lambda: version("rhs"))

    def text(self) -> str:
        """As it travels."""
        return json.dumps(asdict(self))


def run_chunk(text: str) -> str:
    """Run a chunk; a line of JSON for each job, and one about the whole. Raises EngineError where the job server dies."""
    server = _taken()
    try:
        answer = server.ask(text)
    except BaseException:
        server.close()
        raise
    with _guard:
        _idle.append(server)
    return answer


_guard = threading.Lock()
_idle: list[Server] = []


def _taken() -> Server:
    """A job server that has nothing to do."""
    with _guard:
        while _idle:
            server = _idle.pop()
            if server.process.poll() is None:
                return server
    return Server()


class Server:
    """A job server and the pipe to it. It ends when its input does: with this process, however that ends."""

    def __init__(self) -> None:
        self.said = tempfile.TemporaryFile("w+")
        self.process = subprocess.Popen([sys.executable, "-m", "rhs.sweeps.jobserver"], stdin=subprocess.PIPE, text=True,
                                        stdout=subprocess.PIPE, stderr=self.said, start_new_session=True)

    def ask(self, text: str) -> str:
        """Send a chunk and wait for its answer."""
        assert self.process.stdin is not None and self.process.stdout is not None
        lines: list[str] = []
        with contextlib.suppress(OSError):
            self.process.stdin.write(text + "\n")
            self.process.stdin.flush()
            for line in self.process.stdout:
                lines.append(line)
                if line.startswith('{"end"'):
                    return "".join(lines)
        raise EngineError(f"the job server ended with {self.process.wait()}{self._last_words()}")

    def close(self) -> None:
        """Close its input: it kills its jobs and goes."""
        with contextlib.suppress(OSError):
            if self.process.stdin is not None:
                self.process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(5.0)
        self.process.kill()

    def _last_words(self) -> str:
        with contextlib.suppress(OSError, ValueError):
            self.said.seek(0)
            lines = self.said.read()[-2000:].strip().splitlines()
            return f": {lines[-1][:200]}" if lines else ""
        return ""
