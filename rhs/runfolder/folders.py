"""Folders for results: claimed before anything runs, never shared, never overwritten unasked.

A folder is claimed by an exclusive lock on its `.lock` file, which the system gives up when the process ends, however it
ends. A finished run is a folder with row.json, a finished sweep one with sweep.json.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import tempfile
import time
from pathlib import Path

from rhs.base.errors import ConfigError

ROOT = Path("results")


class Claim:
    """A folder that is ours as long as this object is open. made: the folders that did not exist before, deepest first."""

    def __init__(self, folder: Path, lock: int, made: list[Path]) -> None:
        self.folder, self._lock, self._made = folder, lock, made

    def close(self) -> None:
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def __enter__(self) -> Claim:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: object) -> None:
        if isinstance(error, ConfigError):
            self._take_back()
        self.close()

    def _take_back(self) -> None:
        """A run that was refused leaves no folder behind, unless somebody wrote into it."""
        if self._made and [path.name for path in self.folder.iterdir()] == [".lock"]:
            (self.folder / ".lock").unlink()
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()


def claim_run(output: str, *, seed: int, overwrite: bool = False) -> Claim:
    """The folder of one run: `output`, or a new one under results/runs.

    Raises ConfigError when it holds a finished run (unless overwrite), is in use, or cannot be written.
    """
    if not output:
        return _claim_new(ROOT / "runs", f"{_now()}_seed{seed}")
    folder = _absolute(output)
    if _holds(folder, "row.json") and not overwrite:
        raise ConfigError(f"output={output} already holds a finished run; take another folder or type overwrite=true")
    if _holds(folder, "sweep.json"):
        raise ConfigError(f"output={output} holds a sweep; take another folder")
    return _claim(folder)


def claim_sweep(output: str, *, resume: bool = False) -> Claim:
    """The folder of a sweep: `output`, or a new one under results/sweeps. Raises ConfigError like claim_run."""
    if not output:
        return _claim_new(ROOT / "sweeps", _now())
    folder = _absolute(output)
    if _holds(folder, "sweep.json") and not resume:
        raise ConfigError(f"output={output} already holds a sweep; go on with it by --resume or take another folder")
    if _holds(folder, "row.json"):
        raise ConfigError(f"output={output} holds a single run; take another folder")
    return _claim(folder)


def job_folder(sweep: Path, name: str) -> Path:
    """The folder of one job, which must stay inside the sweep's."""
    if not re.fullmatch(r"[A-Za-z0-9._=,+-]{1,100}", name) or name.startswith("."):
        raise ConfigError(f"job name {name!r} is not a plain folder name")
    return sweep / name


def _absolute(output: str) -> Path:
    if "\0" in output:
        raise ConfigError("output: a path cannot hold a zero byte")
    return Path(output).expanduser().absolute()


def _now() -> str:
    return time.strftime("%Y-%m-%d_%H-%M-%S")


def _holds(folder: Path, name: str) -> bool:
    try:
        return (folder / name).exists()
    except OSError as error:  # a name too long for the file system
        raise _unwritable(folder, error) from error


def _claim_new(parent: Path, name: str) -> Claim:
    """A folder that did not exist a moment ago; two runs in one second get two names."""
    made = _make(parent.absolute())
    for attempt in range(1, 1000):
        folder = parent.absolute() / (name if attempt == 1 else f"{name}_{attempt}")
        try:
            folder.mkdir()
        except FileExistsError:
            continue
        except OSError as error:
            raise _unwritable(folder, error) from error
        return _claim(folder, [folder, *made])
    raise ConfigError(f"{parent} already holds a thousand folders named {name}; type output=FOLDER")


def _make(folder: Path) -> list[Path]:
    """The folder and its parents made; those that did not exist before, deepest first."""
    try:
        made = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(folder, error) from error
    return made


def _claim(folder: Path, made: list[Path] | None = None) -> Claim:
    made = _make(folder) if made is None else made
    try:
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"x")
        lock = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise _unwritable(folder, error) from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise ConfigError(f"{folder} is in use by another run; wait for it or take another folder") from None
    return Claim(folder, lock, made)


def _unwritable(folder: Path, error: OSError) -> ConfigError:
    shown = str(folder) if len(str(folder)) < 100 else f"{str(folder)[:97]}..."
    return ConfigError(f"cannot write into {shown}: {error.strerror}; choose another by output=FOLDER")
