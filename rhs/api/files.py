"""Files that appear whole or not at all: written beside their place, flushed to disk, then renamed (level 1).

A crash leaves only names with `.tmp-` in them, which every reader of run folders ignores.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from rhs.base.errors import RhsError
from rhs.base.system import free_space_mb


@contextmanager
def replacing(path: Path, mode: str = "w") -> Iterator[IO[Any]]:
    """A file to write; on leaving the block without an error it takes the place of `path`, otherwise it vanishes.

    Text is UTF-8 with LF line ends on every system. Raises RhsError naming the path and the free space when the disk
    refuses; the previous file is then untouched.
    """
    partial = Path(path).with_name(f"{Path(path).name}.tmp-{os.getpid()}")
    text = {} if "b" in mode else {"encoding": "utf-8", "newline": "\n"}
    with _renamed(partial, Path(path)), partial.open(mode, **text) as file:  # type: ignore[call-overload]
        yield file
        file.flush()
        os.fsync(file.fileno())


def write_whole(path: Path, write: Callable[[Path], object]) -> Path:
    """Let `write` make a file of the same ending beside `path`, then rename it: for libraries that want a name."""
    path = Path(path)
    partial = path.with_name(f"{path.stem}.tmp-{os.getpid()}{path.suffix}")
    with _renamed(partial, path):
        write(partial)
        with partial.open("r+b") as file:
            os.fsync(file.fileno())
    return path


@contextmanager
def _renamed(partial: Path, path: Path) -> Iterator[None]:
    """What the block leaves at `partial` takes the place of `path`; it vanishes where something went wrong."""
    try:
        yield
        os.replace(partial, path)
    except OSError as error:
        raise RhsError(f"cannot write {path}: {error.strerror or error}{_what_to_do(error, path)}") from error
    finally:
        partial.unlink(missing_ok=True)


def _what_to_do(error: OSError, path: Path) -> str:
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return "; a part may keep files open: close them there, or raise the limit (ulimit -n)"
    if not path.parent.is_dir():
        return "; its folder was removed under way: a part may have done it"
    return f" ({free_space(path)}); free some space or choose another folder"


def free_space(path: Path) -> str:
    """Words for the space left where `path` would be."""
    try:
        return f"{free_space_mb(Path(path).parent):.0f} MB free"
    except OSError:
        return "free space unknown"
