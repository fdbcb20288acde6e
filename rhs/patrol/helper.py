"""A second process for what a run leaves behind and nobody waits for: places compared with the survey, pictures at the end.

It loads what compares and draws while the run loads what drives, and is told what to do in pickled requests through a pipe.
What it cannot do, or where it is gone, the run does itself. It ends with the run, whatever ends that; a Ctrl-C is the run's.
"""

from __future__ import annotations

import io
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from rhs.base import processes
from rhs.base.system import ENDINGS

CODE = "import sys; sys.path[:] = sys.argv[1:]; from rhs.patrol.helper import serve; serve()"
STANDS_BACK = 10  # nice(2): what the run waits for goes first


class Helper:
    """The process. Begin it where a processor is to spare; `close` it. Raises OSError where none can be started."""

    def __init__(self) -> None:
        self._alone = threading.Lock()
        with signals_blocked():  # for the process's life
            self._process: subprocess.Popen[bytes] | None = subprocess.Popen(
                [sys.executable, "-c", CODE, *sys.path], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL)

    def ask(self, call: Callable[..., Any], *values: Any) -> Any:
        """What a function of a module gives there. Raises what it raised there, and OSError or EOFError where the process is
        gone: who asks does it himself then, and what is wrong comes out in the run."""
        with self._alone:
            process = self._process
            if process is None or process.stdin is None or process.stdout is None:
                raise EOFError
            send(process.stdin, (call, values))
            value, raised = received(process.stdout)
        if raised is not None:
            raise raised
        return value

    def close(self) -> None:
        """It is not needed any more."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()


@contextmanager
def signals_blocked() -> Iterator[None]:
    """Signals that ask a process to end wait meanwhile; a process that is started now never hears of them."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, *ENDINGS})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def send(file: IO[bytes], value: Any) -> None:
    """Write a value to a pipe, with its size before it."""
    data = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    file.write(len(data).to_bytes(8, "little"))
    file.write(data)
    file.flush()


def received(file: IO[bytes]) -> Any:
    """The next value of a pipe. Raises EOFError where it has ended."""
    size = file.read(8)
    data = file.read(int.from_bytes(size, "little"))
    if len(size) < 8:
        raise EOFError
    return pickle.loads(data)  # noqa: S301 (from the process at the other end)


def serve() -> None:
    """Load what compares and draws, and do what is asked for until the pipe ends."""
    processes.die_with_parent()
    if hasattr(os, "nice"):  # not on Windows
        os.nice(STANDS_BACK)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is printed is no answer
    load()
    while True:
        value = raised = None
        try:
            call, values = received(requests)
            value = call(*values)
        except EOFError:
            return
        except Exception as error:
            raised = error
        send(answers, (value, raised))


def load() -> None:
    """Load what compares, and what draws by a picture that nobody sees."""
    import cv2
    import scipy.spatial.transform  # noqa: F401

    from rhs.estimation.views import changes, references  # noqa: F401
    from rhs.plots import new_figure, save
    from rhs.reports import report  # noqa: F401

    cv2.setNumThreads(1)
    figure = new_figure(1.0, 1.0)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], label="m")
    axes.contour([[0.0, 1.0], [1.0, 0.0]], levels=[0.5])
    figure.legend(loc="outside lower center")
    save(figure, io.BytesIO())


def pictures(folder: Path) -> None:
    """Draw the pictures of a run folder."""
    from rhs.reports import report

    report.pictures(folder)
