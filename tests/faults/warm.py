"""The command line without its import time: a process that has imported everything, and forks for each command.

A command in a fork is `python -m MODULE WORDS` but for what was imported before; its CPU time and its memory are what the
system counted for it. Run as a program this file is that process: orders in, answers out, one line of JSON each.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Spent:
    """What became of a command: exit code (negative: the signal), most memory, and times."""

    code: int
    peak_mb: float
    cpu_s: float
    wall_s: float


class Warm:
    """The process that forks. One per worker of the tests; `close` ends it."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.process = subprocess.Popen(
            [sys.executable, __file__], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._heard = b""  # what of its answers nobody has asked for yet
        self._hear(120.0)
        self.kept: dict[str, Any] = {}  # answers that several tests look at

    def run(
        self,
        module: str,
        words: list[str],
        folder: Path,
        *,
        out: Path,
        err: Path,
        timeout_s: float = 120.0,
        limits: dict[str, int] | None = None,
        environment: dict[str, str] | None = None,
    ) -> Spent:
        """Run a command in `folder`, its words to the files out and err. Raises TimeoutError when it takes too long."""
        order = {
            "module": module,
            "words": words,
            "folder": str(folder),
            "out": str(out),
            "err": str(err),
            "limits": limits or {},
            "environment": environment or {},
        }
        began_s = time.monotonic()
        self.process.stdin.write(json.dumps(order) + "\n")  # type: ignore[union-attr]
        pid = self._hear(10.0)["pid"]
        try:
            answer = self._hear(timeout_s)
        except TimeoutError:
            with suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
            self._hear(10.0)
            raise
        return Spent(**answer, wall_s=time.monotonic() - began_s)

    def _hear(self, timeout_s: float) -> dict[str, Any]:
        """The next answer. Read past Python's buffer: of two lines that come at once `select` would not show the second."""
        while b"\n" not in self._heard:
            if not select.select([self.process.stdout], [], [], timeout_s)[0]:
                raise TimeoutError(f"no answer for {timeout_s:g} s")
            piece = os.read(self.process.stdout.fileno(), 65536)  # type: ignore[union-attr]
            if not piece:
                raise EOFError("the process that forks has ended")
            self._heard += piece
        line, _, self._heard = self._heard.partition(b"\n")
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        self.process.stdin.close()  # type: ignore[union-attr]
        self.process.wait(10)


def _serve() -> None:
    """The forking side."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    _import_all()
    answers.write("{}\n")
    for line in sys.stdin:
        order = json.loads(line)
        pid = os.fork()
        if pid == 0:
            answers.close()
            _command(order)
        answers.write(json.dumps({"pid": pid}) + "\n")
        _, status, usage = os.wait4(pid, 0)
        answers.write(
            json.dumps(
                {
                    "code": os.waitstatus_to_exitcode(status),
                    "peak_mb": usage.ru_maxrss / 1024,
                    "cpu_s": usage.ru_utime + usage.ru_stime,
                }
            )
            + "\n"
        )


def _import_all() -> None:
    """What every command imports sooner or later; no plugin of a stranger."""
    import importlib

    from rhs.sweeps.jobs import PRELOAD

    for name in (
        *PRELOAD[:-1],
        "rhs.cli.main",
        "numpy",
        "scipy.ndimage",
        "cv2",
        "numba",
        "pandas",
        "hydra",
        "rhs.config.compose",
        "rhs.patrol.run",
        "rhs.patrol.job",
        "rhs.metrics.evaluate",
        "rhs.reports.table",
        "rhs.cli.convert",
        "rhs.cli.evaluate",
        "rhs.sweeps.sweep",
        "rhs_sources.replay",
        "rhs_tasks.planning.settings",
    ):
        importlib.import_module(name)


def _command(order: dict[str, Any]) -> None:
    """In the fork: become the command, and end with its exit code."""
    import atexit
    import resource
    import runpy
    import traceback

    os.setsid()
    os.chdir(order["folder"])
    for path, target in ((os.devnull, 0), (order["out"], 1), (order["err"], 2)):
        os.dup2(os.open(path, os.O_RDWR | os.O_CREAT), target)
    os.environ.update(order["environment"])
    for name, most in order["limits"].items():
        resource.setrlimit(getattr(resource, name), (most, most))
    sys.argv = [order["module"], *order["words"]]
    sys.path[:1] = [order["folder"], *order["environment"]["PYTHONPATH"].split(os.pathsep)]
    code: object = 0
    try:
        runpy.run_module(order["module"], run_name="__main__", alter_sys=True)
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
        code = 1
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code if isinstance(code, int) else 0 if code is None else 1)


if __name__ == "__main__":
    _serve()
