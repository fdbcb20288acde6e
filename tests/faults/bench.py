"""What a fault is tried with: commands in a folder, and what must hold of every answer."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from faults.warm import Spent, Warm
from installing import CHOICE, FAKES, environment, interruptible

from rhs.runfolder.row import read_row

MOST_MB, MOST_S = 500.0, 2.0  # of a refusal: memory in all, CPU time beyond importing
HERE = Path(__file__).resolve().parent
HOSTILE = ["--plugin", str(HERE / "hostile.py")]  # parts of these tests, chosen by odometry=hostile and the like
LONGEST_LINE = 260
LIGHT = ["recording=off", "pictures=off"]


@dataclass(frozen=True)
class Answer:
    """What a command left behind. code: its exit code; folder: where it ran; spent: None where nobody counted."""

    code: int
    out: str
    err: str
    folder: Path
    spent: Spent | None = None

    def row(self, run: str = "run") -> dict[str, Any]:
        return read_row(self.folder / run / "row.json")

    def rows(self, sweep: str = "s") -> dict[str, dict[str, Any]]:
        """Words that were swept -> row, of every job."""
        return {path.parent.name.rpartition("_")[0]: read_row(path) for path in (self.folder / sweep).glob("*/row.json")}

    def steps(self, column: str, run: str = "run") -> list[str]:
        """A column of steps.csv."""
        import csv

        with (self.folder / run / "steps.csv").open() as file:
            return [line[column] for line in csv.DictReader(file)]


def parts(**changed: str) -> list[str]:
    """The words that choose the light parts, but for these."""
    return [f"{kind}={changed.get(kind, 'fake')}" for kind in (word.partition("=")[0] for word in CHOICE)]


def hostile(kind: str, how: str) -> list[str]:
    """The words for light parts, one of which is tests/faults/hostile.py's and behaves as said."""
    return [*HOSTILE, *parts(**{kind: "hostile"}), f"{kind}.how={how}", "source.views=4", *LIGHT]


class Bench:
    """One fault's folder, and the command line in it."""

    def __init__(self, folder: Path, warm: Warm, data: Callable[[str], Path]) -> None:
        self.home, self.warm, self.data = folder, warm, data
        self.folder = folder / "work"
        self.golden = HERE.parent / "golden"
        self.folder.mkdir()
        (folder / "canary").write_text("nobody may touch what lies beside the folder of work")

    def file(self, name: str, content: str | bytes = "") -> Path:
        """A file in the folder of work."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    def ask(
        self,
        *words: str,
        code: int | tuple[int, ...] = 2,
        says: str | tuple[str, ...] | None = "",
        module: str = "rhs",
        site: str = "",
        alone: bool = True,
        timeout_s: float = 120.0,
        limits: dict[str, int] | None = None,
        **environment: str,
    ) -> Answer:
        """Run a command in a warm process; its exit code, its one line and what must hold of every command are checked.

        site: a folder of one more installed distribution. alone: nothing else is at work in the folder."""
        before, outside = self.listed() if alone else {}, self._outside()  # what is at work renames files as they are listed
        out, err = self.home / "out.txt", self.home / "err.txt"
        for path in (out, err):
            path.write_text("")
        spent = self.warm.run(
            module,
            list(words),
            self.folder,
            out=out,
            err=err,
            timeout_s=timeout_s,
            limits=limits,
            environment={**environment, "PYTHONPATH": os.pathsep.join(filter(None, [site, str(FAKES)]))},
        )
        answer = Answer(spent.code, out.read_text(), err.read_text(), self.folder, spent)
        check(answer, code, says)
        assert self._outside() == outside, "something was written outside the folder of work"
        if code == 2:
            assert not alone or self.listed() == before, "a refusal leaves everything as it was"
            assert spent.peak_mb <= MOST_MB and spent.cpu_s <= MOST_S, spent
        return answer

    def start(
        self, *words: str, module: str = "rhs", limit: Callable[[], None] | None = None, **more: str
    ) -> subprocess.Popen:
        """The same as a process of its own, under way."""

        def begin() -> None:
            interruptible()
            if limit is not None:
                limit()

        return subprocess.Popen(
            [sys.executable, "-m", module, *words],
            cwd=self.folder,
            env=environment(FAKES, **more),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=begin,
        )

    def ends(
        self, process: subprocess.Popen, code: int, says: str | tuple[str, ...] = "", timeout_s: float = 200.0
    ) -> Answer:
        """Wait for a process that was started, and check its answer; nothing of its group is left two seconds later."""
        out, err = process.communicate(timeout=timeout_s)
        answer = Answer(process.returncode, out, err, self.folder)
        check(answer, code, says)
        self.wait(lambda: not _alive(process.pid), 2.0)
        return answer

    def process(
        self, *words: str, code: int, says: str | tuple[str, ...] = "", timeout_s: float = 300.0, **more: Any
    ) -> Answer:
        """A command as a process of its own, from beginning to end."""
        return self.ends(self.start(*words, **more), code, says, timeout_s)

    def once(self, make: Callable[[Bench], Answer]) -> Answer:
        """What `make` answers, made once for all faults that look at it."""
        if make.__name__ not in self.warm.kept:
            self.warm.kept[make.__name__] = make(self)
        kept: Answer = self.warm.kept[make.__name__]
        return kept

    def wait(self, true: Callable[[], object], seconds: float = 90.0) -> None:
        end_s = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end_s, f"waited {seconds:g} s in vain"
            time.sleep(0.02)

    def listed(self) -> dict[str, tuple[int, int]]:
        """Every path in the folder of work: when it changed, and its size."""
        return {
            str(path.relative_to(self.folder)): (path.lstat().st_mtime_ns, path.lstat().st_size)
            for path in sorted(self.folder.rglob("*"))
        }

    def _outside(self) -> list[str]:
        return sorted(path.name for path in self.home.iterdir() if path.name not in ("out.txt", "err.txt")) + [
            (self.home / "canary").read_text() if (self.home / "canary").exists() else "gone"
        ]


def check(answer: Answer, code: int | tuple[int, ...], says: str | tuple[str, ...] | None) -> None:
    """Exit code, one line of complaint and no more, no traceback, nothing that commands a terminal.

    says: what stands in the line; none is expected after 0, unless something is to be said, nor of a killed process. None:
    there may be a line or not."""
    lines = [line for line in answer.err.splitlines() if not line.startswith("compiling inner loops")]  # once a machine
    told = f"{answer.code}: {answer.err[:2000]}\n{answer.out[-500:]}"
    assert answer.code in ((code,) if isinstance(code, int) else code), told
    assert len(lines) <= 1 if says is None else len(lines) == (0 if answer.code <= 0 and not says else 1), told
    assert not lines or len(lines[0]) <= LONGEST_LINE, told
    assert "Traceback" not in answer.err + answer.out, told
    assert all(c.isprintable() or c in "\n\r\t" for c in answer.err + answer.out), told
    for part in (says,) if isinstance(says, str) else says or ():
        assert part in answer.err, told


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def accounts(sweep: Path) -> dict[str, str]:
    """jobs.json of a sweep."""
    told: dict[str, str] = json.loads((sweep / "jobs.json").read_text())
    return told
