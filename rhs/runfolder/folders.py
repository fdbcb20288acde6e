"""Folders for results: claimed before anything runs, never shared, never overwritten unasked.

A folder is claimed by an exclusive lock on its `.lock` file, which the system gives up when the process ends, however it
ends. A run is a folder with row.json, a sweep one with sweep.json.

A run folder is a transaction. An attempt always begins in a folder that holds nothing: a new one, or, where a run is to
be overwritten, `.attempt-PID` inside it. `Claim.publish` then renames what the attempt made into the place of what was
there before; until then, and whenever the attempt is killed, the earlier run stays whole.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rhs.base.errors import ConfigError, RhsError
from rhs.base.system import lock_file

ROOT = Path("results")
LOCK, ROW = ".lock", "row.json"
NONBLOCK = getattr(os, "O_NONBLOCK", 0)  # not on Windows
PATIENCE_S = 0.2  # somebody may be looking at the lock just now


class Claim:
    """A folder that is ours as long as this object is open. folder: where to write. made: the folders that did not exist
    before, deepest first."""

    def __init__(self, folder: Path, lock: int, made: list[Path]) -> None:
        self.folder, self._home, self._locks, self._made = folder, folder, [lock], made

    def stage(self) -> None:
        """From now on `folder` is a new one inside the claimed one, until `publish`."""
        attempt = self._home / f".attempt-{os.getpid()}"
        shutil.rmtree(attempt, ignore_errors=True)  # of a dead process with our number
        with _writing_into(attempt):
            attempt.mkdir()
        self._locks.append(lock(attempt))
        self.folder = attempt

    def publish(self) -> Path:
        """What was made takes the place of what was there before; the folder of the run. The row is what goes first and
        comes last: whoever looks meanwhile finds no row rather than one beside files of another run."""
        if self.folder == self._home:
            return self._home
        attempt, aside = self.folder, self._home / f".before-{os.getpid()}"
        try:
            aside.mkdir(exist_ok=True)
            before = [path for path in self._home.iterdir() if path.name != LOCK and path not in (attempt, aside)]
            for path in sorted(before, key=lambda path: path.name != ROW):
                path.rename(aside / path.name)
            for path in sorted(attempt.iterdir(), key=lambda path: path.name == ROW):
                if path.name != LOCK:
                    path.rename(self._home / path.name)
        except OSError as error:
            raise RhsError(f"cannot put {attempt} into the place of {self._home}: {error.strerror}") from error
        shutil.rmtree(attempt, ignore_errors=True)
        shutil.rmtree(aside, ignore_errors=True)
        self.folder = self._home
        return self._home

    def close(self) -> None:
        while self._locks:
            os.close(self._locks.pop())

    def __enter__(self) -> Claim:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, ConfigError):
            self._take_back()
        elif _is_finished(self.folder):
            self.publish()
        self.close()

    def _take_back(self) -> None:
        """A run that was refused leaves no folder behind, unless somebody wrote into it."""
        if self.folder != self._home:
            shutil.rmtree(self.folder, ignore_errors=True)
            return
        if self._made and [path.name for path in self.folder.iterdir()] == [LOCK]:
            (self.folder / LOCK).unlink()
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()


def claim_run(output: str, *, seed: int, overwrite: bool = False) -> Claim:
    """The folder of one run: `output`, or a new one under results/runs.

    Raises ConfigError when it holds a run (unless overwrite) or anything else, is in use, or cannot be written.
    """
    _check_here()
    if not output:
        return _claim_new(ROOT / "runs", f"{_now()}_seed{seed}")
    folder = _absolute(output)
    if _holds(folder, "sweep.json"):
        raise ConfigError(f"output={output} holds a sweep; take another folder")
    claim = _claim(folder)
    held = [path.name for path in folder.iterdir() if path.name != LOCK]
    try:
        if held and not overwrite and _holds(folder, ROW):
            raise ConfigError(f"output={output} already holds a {'finished' if _is_finished(folder) else 'killed'} run; "
                              f"take another folder or type overwrite=true")
        if held and not {ROW, "config.yaml"} & set(held) and not all(name.startswith(".") for name in held):
            raise ConfigError(f"output={output} holds other files ({', '.join(sorted(held)[:3])}); take a folder that is "
                              f"new or empty")
        if held:
            claim.stage()
    except ConfigError:
        claim.close()
        raise
    return claim


def claim_sweep(output: str, *, resume: bool = False) -> Claim:
    """The folder of a sweep: `output`, or a new one under results/sweeps. Raises ConfigError like claim_run."""
    _check_here()
    if not output:
        return _claim_new(ROOT / "sweeps", _now())
    folder = _absolute(output)
    if _holds(folder, "sweep.json") and not resume:
        raise ConfigError(f"output={output} already holds a sweep; go on with it by --resume or take another folder")
    if _holds(folder, ROW):
        raise ConfigError(f"output={output} holds a single run; take another folder")
    return _claim(folder)


def claim_again(folder: Path) -> Claim:
    """A folder that exists, as it is. Raises ConfigError when it is in use or there is none."""
    if not folder.is_dir():
        raise ConfigError(f"{folder} is not a folder; give a run or sweep folder")
    return Claim(folder, lock(folder), [])


def job_folder(sweep: Path, name: str) -> Path:
    """The folder of one job, which must stay inside the sweep's."""
    if not re.fullmatch(r"[A-Za-z0-9._=,+-]{1,100}", name) or name.startswith("."):
        raise ConfigError(f"job name {name!r} is not a plain folder name")
    return sweep / name


def lock(folder: Path) -> int:
    """The open lock of a folder. Raises ConfigError when somebody else has it, or nobody can."""
    with _writing_into(folder):
        descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | NONBLOCK, 0o644)
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            lock_file(descriptor)
            return descriptor
        except OSError:
            if time.monotonic() > end:
                os.close(descriptor)
                raise ConfigError(f"{folder} is in use by another run; wait for it or take another folder") from None
            time.sleep(0.01)


def is_in_use(folder: Path) -> bool:
    """Whether a process has claimed this folder and still lives."""
    try:
        descriptor = os.open(folder / LOCK, os.O_RDONLY | NONBLOCK)
    except OSError:
        return False
    try:
        lock_file(descriptor, shared=True)
        return False
    except OSError:
        return True
    finally:
        os.close(descriptor)


def set_aside(sweep: Path, folders: list[Path]) -> Path | None:
    """Move folders out of a sweep into a new one beside it, `NAME.before-DATE_TIME`; None where there are none."""
    if not folders:
        return None
    aside = _claim_new(sweep.parent, f"{sweep.name}.before-{_now()}")
    for folder in folders:
        folder.rename(aside.folder / folder.name)
    aside.close()
    return aside.folder


def _is_finished(folder: Path) -> bool:
    """Whether there is a row that says what became of the run."""
    try:
        return '"status": "running"' not in (folder / ROW).read_text(encoding="utf-8", errors="replace")[:200]
    except OSError:
        return False


def _check_here() -> None:
    """Parts, and the paths that were typed, need a working directory."""
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise ConfigError("the folder that this was started in is gone; cd to one that is there") from error


def _absolute(output: str) -> Path:
    if "\0" in output:
        raise ConfigError("output: a path cannot hold a zero byte")
    try:
        return Path(output).expanduser().absolute()
    except RuntimeError as error:
        raise ConfigError(f"output={output}: {error}; write the folder out") from error


def _now() -> str:
    return time.strftime("%Y-%m-%d_%H-%M-%S")


def _holds(folder: Path, name: str) -> bool:
    with _writing_into(folder):  # a name may be too long for the file system
        return (folder / name).exists()


def _claim_new(parent: Path, name: str) -> Claim:
    """A folder that did not exist a moment ago; two runs in one second get two names."""
    made = _make(parent.absolute())
    for attempt in range(1, 1000):
        folder = parent.absolute() / (name if attempt == 1 else f"{name}_{attempt}")
        with _writing_into(folder):
            try:
                folder.mkdir()
            except FileExistsError:
                continue
        return _claim(folder, [folder, *made])
    raise ConfigError(f"{parent} already holds a thousand folders named {name}; type output=FOLDER")


def shown(path: str) -> str:
    """A path as text that can be printed and written, with ? for what this locale cannot read."""
    return path.encode("utf-8", "replace").decode("utf-8")


def _make(folder: Path) -> list[Path]:
    """The folder and its parents made; those that did not exist before, deepest first."""
    if shown(str(folder)) != str(folder):
        raise ConfigError(f"{shown(str(folder))}: this locale cannot read the folder's name; set PYTHONUTF8=1, or take "
                          "another by output=FOLDER")
    with _writing_into(folder):
        made = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    return made


def _claim(folder: Path, made: list[Path] | None = None) -> Claim:
    made = _make(folder) if made is None else made
    with _writing_into(folder), tempfile.TemporaryFile(dir=folder) as probe:
        probe.write(b"x")
    return Claim(folder, lock(folder), made)


@contextlib.contextmanager
def _writing_into(folder: Path) -> Iterator[None]:
    """Inside, what the system refuses is a ConfigError."""
    try:
        yield
    except OSError as error:
        shown = str(folder) if len(str(folder)) < 100 else f"{str(folder)[:97]}..."
        raise ConfigError(f"cannot write into {shown}: {error.strerror}; choose another by output=FOLDER") from error
