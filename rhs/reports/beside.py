"""The pictures of a run, drawn by a process of its own: it loads what draws while the run is still under way on the other
processor. Whatever goes wrong there, the run draws them itself."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from rhs.base import processes

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
        if self._process is None:
            return False
        try:
            said, _ = self._process.communicate(f"{folder.resolve()}\n")
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
            process.communicate()


def serve() -> None:
    """Load what draws, hear of a folder, draw it and say so."""
    processes.die_with_parent()
    import cv2  # noqa: F401
    import matplotlib.backends.backend_agg  # noqa: F401
    import scipy.spatial.transform  # noqa: F401

    from . import report

    if folder := sys.stdin.readline().rstrip("\n"):
        report.pictures(Path(folder))
        sys.stdout.write(f"{DRAWN}\n")
