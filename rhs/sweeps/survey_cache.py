"""Surveys kept on the disk, so that a later sweep does not lead them again.

A file's name is a hash of all that its survey depends on (`key_of`); it holds a pickle, and a digest of it, so that one
that was cut or changed is led anew. Files are written whole and renamed, and the one that was used longest ago goes first:
any number of processes may read, write and clear at the same time. A pickle is code: only files that are this user's own,
in a folder of his own, that nobody else may write to, are read.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import pickle
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.api.files import replacing
from rhs.api.frozen import freeze
from rhs.base.errors import ConfigError, RhsError
from rhs.base.provenance import code_hash, versions
from rhs.config import registry
from rhs.worlds.random.names import is_random

if TYPE_CHECKING:
    from rhs.api.floorplan import World
    from rhs.config.compose import RunConfig
    from rhs.patrol.shared_survey import SharedSurvey

logger = logging.getLogger("rhs.sweeps")
FOLDER, MOST_MB = "RHS_CACHE", "RHS_CACHE_MB"  # variables of the environment: where, and how much (0: nothing is kept)
DEFAULT_MB = 2000.0
ENDING = ".survey"
DIGEST_BYTES = 32
PACKING = 1  # a third of the size, for a third of the time that pickling takes besides


def cache_folder() -> Path:
    """Where surveys are kept: below RHS_CACHE, else below the user's folder for caches."""
    cache = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(os.environ.get(FOLDER) or Path(cache) / "rhs").expanduser() / "surveys"


def most_mb() -> float:
    """What the folder may hold. Raises ConfigError where RHS_CACHE_MB is no size."""
    text = os.environ.get(MOST_MB) or str(DEFAULT_MB)
    with suppress(ValueError):
        if 0.0 <= float(text) < float("inf"):
            return float(text)
    raise ConfigError(f"{MOST_MB}={text}: expected megabytes, 0 for no cache; for example {MOST_MB}={DEFAULT_MB:g}")


def building_read(config: RunConfig) -> World | None:
    """The building of a run as it is read from its files, for the key and for the run; None of one that is drawn, which its
    name tells, or of a survey that is not shared."""
    from rhs.patrol.run import building_of
    from rhs.patrol.shared import survey_values

    return None if is_random(config.world) or survey_values(config) is None else building_of(config)


def key_of(config: RunConfig, building: World | None) -> str | None:
    """The name of the survey that a run begins with: a hash of its settings, of the building, of the files that are named
    in it, of the code of its parts and of what is installed. None: of a survey that is not shared, or of whose parts' code
    less than all is known (those registered by hand)."""
    from rhs.patrol.shared import survey_values
    from rhs.patrol.shared_survey import LATER

    values = survey_values(config)
    if values is None:
        return None
    chosen = {"task": config.task.name, **{kind: one.name for kind, one in config.parts.items() if kind not in LATER}}
    origins = [origin for kind, name in chosen.items() for origin in registry.origins(kind, name)]
    code = {name: code_hash(name) for name in {"rhs", *(one.value.partition(":")[0].partition(".")[0] for one in origins)}}
    if any(origin.file for origin in origins) or not all(code.values()):
        return None
    read = b"" if building is None else pickle.dumps(replace(building, path=Path()))
    known = [values, sorted(code.items()), versions(), _installed(), sorted(_stamps(values)), _digest(read).hex()]
    return _digest(json.dumps(known, sort_keys=True).encode()).hex()[:32]


def load(key: str) -> SharedSurvey | None:
    """The survey of this name, as it was led; None where it is not kept or cannot be read."""
    import zstandard

    path = cache_folder() / (key + ENDING)
    try:
        for one in (path.parent, path):
            check_own(one)
        content = path.read_bytes()
        if _digest(memoryview(content)[DIGEST_BYTES:]) != content[:DIGEST_BYTES]:
            raise ValueError("the file was cut or changed")
        plain = zstandard.ZstdDecompressor().decompress(memoryview(content)[DIGEST_BYTES:])
        shared: SharedSurvey = pickle.loads(plain)  # noqa: S301 (see check_own)
        os.utime(path)
    except FileNotFoundError:
        return None
    except Exception as error:  # whatever is in the way, the survey is led anew
        logger.warning("%s is not taken: %s", path, error)
        return None
    freeze((shared.survey, shared.steps))
    logger.info("the survey is that of %s", path)
    return replace(shared, kept=True)


def check_own(path: Path) -> None:
    """Raises RhsError for what somebody else owns or may write to."""
    about = path.stat()
    if hasattr(os, "getuid") and (about.st_uid != os.getuid() or about.st_mode & 0o022):
        raise RhsError(f"{path} is another user's, or others may write to it: chmod go-w it, or set {FOLDER}")


def keep(key: str, shared: SharedSurvey) -> None:
    """Keep a survey, and make room for it. Does nothing where a part cannot be pickled or nothing may be written."""
    import zstandard

    folder = cache_folder()
    if shared.drawn:
        return
    try:
        content = zstandard.ZstdCompressor(level=PACKING).compress(pickle.dumps(shared, pickle.HIGHEST_PROTOCOL))
    except Exception as error:  # parts may hold what belongs to this process
        logger.info("the survey is not kept for other sweeps: %s", error)
        return
    with suppress(OSError, RhsError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if 1e-6 * len(content) <= most_mb():
            clear(most_mb() - 1e-6 * len(content))
            with replacing(folder / (key + ENDING), "wb") as file:
                file.write(_digest(content))
                file.write(content)


@dataclass(frozen=True)
class Kept:
    """count: surveys. size_mb: of all."""

    count: int
    size_mb: float


def kept() -> Kept:
    """What the folder holds."""
    sizes = [size for _, size, _ in _files()]
    return Kept(len(sizes), 1e-6 * sum(sizes))


def clear(most_mb: float = 0.0) -> Kept:
    """Delete those that were used longest ago until no more is left than this. What was deleted."""
    gone, files = [], sorted(_files())
    left = sum(size for _, size, _ in files)
    for _, size, path in files:
        if left <= 1e6 * most_mb:
            break
        with suppress(FileNotFoundError):
            path.unlink()
            gone.append(size)
        left -= size
    return Kept(len(gone), 1e-6 * sum(gone))


def _files() -> list[tuple[float, int, Path]]:
    """When each was used last, its bytes, its path; what a process that was killed left is among them."""
    found = []
    for path in cache_folder().glob(f"*{ENDING}*"):
        with suppress(FileNotFoundError):
            found.append((path.stat().st_mtime, path.stat().st_size, path))
    return found


def _digest(content: bytes | memoryview) -> bytes:
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).digest()


def _installed() -> list[str]:
    """Every distribution with its version, by the names of their folders."""
    return sorted({path.name for folder in sys.path if folder for path in Path(folder).glob("*.dist-info")})


def _stamps(value: Any) -> Iterator[tuple[str, int, int]]:
    """Path, size and time of the files that settings name."""
    for one in value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ():
        yield from _stamps(one)
    if isinstance(value, str) and 0 < len(value) < 1000:
        with suppress(OSError, ValueError):
            path = Path(value).expanduser()
            if path.is_file():
                yield str(path.resolve()), path.stat().st_size, path.stat().st_mtime_ns
