"""The pictures of a run, drawn by a process of its own: it loads what draws while the run begins on the other processor.
Whatever goes wrong there, the run draws them itself."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import get_context
from pathlib import Path

from rhs.base import processes
from rhs.base.system import CAN_FORK

DRAWN = "drawn"
CODE = "import sys; sys.path[:] = sys.argv[1:]; from rhs.reports.beside import serve; serve()"


class Drawer:
    """A process that waits for a run folder to draw. Begin it where a processor is to spare."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        if processes.has_helpers():
            with suppress(OSError):
                self._process = subprocess.Popen([sys.executable, "-c", CODE, *sys.path], stdin=subprocess.PIPE, text=True,
                                                 stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def pictures(self, folder: Path) -> bool:
        """Have the pictures of a run folder drawn; whether all were."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            return False
        try:
            process.stdin.write(f"{folder.resolve()}\n")
            process.stdin.flush()
            said = process.stdout.readline()  # its end is not waited for
        except (OSError, ValueError):
            return False
        finally:
            self.close()
        return said.strip() == DRAWN

    def close(self) -> None:
        """It is not needed any more."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with suppress(OSError):  # what it never read
                process.communicate()


def serve() -> None:
    """Load what draws, hear of a folder, draw it and say so."""
    processes.die_with_parent()
    import cv2  # noqa: F401
    import scipy.spatial.transform  # noqa: F401

    from . import report

    draw_something()
    if folder := sys.stdin.readline().rstrip("\n"):
        draw_apart(report.drawings(Path(folder)))
        sys.stdout.write(f"{DRAWN}\n")
        sys.stdout.flush()


def draw_apart(drawings: Sequence[Callable[[], object]]) -> None:
    """Draw the first here and the others in a process of their own: the run is over, two processors are idle. Raises
    RuntimeError where that failed."""
    if len(drawings) < 2 or not CAN_FORK:
        draw_all(drawings)
        return
    others = get_context("fork").Process(target=draw_all, args=(drawings[1:],))
    others.start()
    draw_all(drawings[:1])
    others.join()
    if others.exitcode:
        raise RuntimeError("a picture failed")


def draw_all(drawings: Sequence[Callable[[], object]]) -> None:
    """Draw one after the other."""
    for draw in drawings:
        draw()


def draw_something() -> None:
    """A picture that nobody sees: Matplotlib loads half of itself when it draws."""
    from rhs.plots import new_figure, save

    figure = new_figure(1.0, 1.0)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], label="m")
    axes.contour([[0.0, 1.0], [1.0, 0.0]], levels=[0.5])
    figure.legend(loc="outside lower center")
    save(figure, io.BytesIO())
