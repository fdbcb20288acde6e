"""Surveys kept on the disk, so that a later sweep does not lead them again.

A file's name is a hash of what its survey depends on (`key_of`); its first line says which code the process had loaded that
led it, by size and time of the files, and where one has changed, or the pickle below was cut, the survey is led anew. Files
are written whole and renamed, and the one that was used longest ago goes first: any number of processes may read, write and
clear at the same time. A pickle is code: only files that are this user's own, in a folder of his own, that nobody else may
write to, are read.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import pickle
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.api.files import replacing
from rhs.api.frozen import freeze
from rhs.base.errors import ConfigError, RhsError
from rhs.base.provenance import versions
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
PACKING = 1  # zstd's level, as of recordings
HERE = Path(__file__).resolve().parents[1]  # rhs
INSTALLED = {"site-packages", "dist-packages"}  # folders of what is known by its version
STANDARD = Path(sysconfig.get_path("stdlib"))


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
    """The name of the survey that a run begins with: a hash of its settings, of the building, of the files that settings
    name, of what is installed and where rhs is. None: of a survey that is not shared, or of parts registered by hand."""
    from rhs.patrol.shared import survey_values

    values = survey_values(config)
    if values is None or any(origin.file for origin in _origins(config, later=False)):
        return None
    read = b"" if building is None or is_random(config.world) else pickle.dumps(replace(building, path=Path()))
    installed = sorted({path.name for folder in sys.path if folder for path in Path(folder).glob("*.dist-info")})
    known = [values, versions(), installed, str(HERE), sorted(_stamps(values)), hashlib.sha256(read).hexdigest()]
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()[:32]


def holds(key: str | None) -> bool:
    """Whether there is a file of this name."""
    return key is not None and (cache_folder() / (key + ENDING)).exists()


def load(key: str) -> SharedSurvey | None:
    """The survey of this name, as it was led; None where it is not kept, cannot be read, or its code has changed since."""
    import zstandard

    path = cache_folder() / (key + ENDING)
    try:
        for one in (path.parent, path):
            check_own(one)
        code, _, packed = path.read_bytes().partition(b"\n")
        if changed := [name for name, *before in json.loads(code) if _stamp(Path(name)) != tuple(before)]:
            logger.info("the survey is led anew: %s has changed", changed[0])
            return None
        shared: SharedSurvey = pickle.loads(zstandard.ZstdDecompressor().decompress(packed))  # noqa: S301 (see check_own)
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


def keep(key: str, config: RunConfig, shared: SharedSurvey) -> None:
    """Keep a survey that this process led, and make room for it. Does nothing where a part cannot be pickled or nothing may
    be written."""
    import zstandard

    folder = cache_folder()
    if shared.drawn:
        return
    try:
        packer = zstandard.ZstdCompressor(level=PACKING, write_checksum=True)
        packed = packer.compress(pickle.dumps(shared, pickle.HIGHEST_PROTOCOL))
    except Exception as error:  # parts may hold what belongs to this process
        logger.info("the survey is not kept for other sweeps: %s", error)
        return
    with suppress(OSError, RhsError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if 1e-6 * len(packed) <= most_mb():
            clear(most_mb() - 1e-6 * len(packed))
            with replacing(folder / (key + ENDING), "wb") as file:
                file.write(json.dumps(sorted(code_of(config))).encode() + b"\n")
                file.write(packed)


def code_of(config: RunConfig) -> Iterator[tuple[str, int, int]]:
    """Path, size and time of the files of all code that this process has loaded and that may be edited: of rhs, of the
    survey's parts, and of all else outside of Python and what is installed in it; not of the parts that come later."""
    own, later = ({one.value.partition(":")[0].partition(".")[0] for one in _origins(config, later=after)}
                  for after in (False, True))
    own.add("rhs")
    for name, module in list(sys.modules.items()):
        file, top = getattr(module, "__file__", None), name.partition(".")[0]
        if not isinstance(file, str) or top in later - own:
            continue
        path = Path(file)
        if top in own or not (INSTALLED & {*path.parts} or path.is_relative_to(STANDARD)):
            with suppress(OSError):
                yield (file, *_stamp(path))


def kept() -> tuple[int, float]:
    """How many surveys the folder holds, and MB of all."""
    sizes = [size for _, size, _ in _files()]
    return len(sizes), 1e-6 * sum(sizes)


def clear(most_mb: float = 0.0) -> tuple[int, float]:
    """Delete those that were used longest ago until no more is left than this. How many were deleted, and MB of all."""
    gone, files = [], sorted(_files())
    left = sum(size for _, size, _ in files)
    for _, size, path in files:
        if left <= 1e6 * most_mb:
            break
        with suppress(FileNotFoundError):
            path.unlink()
            gone.append(size)
        left -= size
    return len(gone), 1e-6 * sum(gone)


def _files() -> list[tuple[float, int, Path]]:
    """When each was used last, its bytes, its path; what a process that was killed left is among them."""
    found = []
    for path in cache_folder().glob(f"*{ENDING}*"):
        with suppress(FileNotFoundError):
            found.append((path.stat().st_mtime, path.stat().st_size, path))
    return found


def _origins(config: RunConfig, *, later: bool) -> list[registry.Origin]:
    """Where the parts are from that a survey asks, or those that come later."""
    from rhs.patrol.shared_survey import LATER

    chosen = {"task": config.task.name, **{kind: one.name for kind, one in config.parts.items()}}
    return [origin for kind, name in chosen.items() if (kind in LATER) is later for origin in registry.origins(kind, name)]


def _stamps(value: Any) -> Iterator[tuple[str, int, int]]:
    """Path, size and time of the files that settings name."""
    for one in value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ():
        yield from _stamps(one)
    if isinstance(value, str) and 0 < len(value) < 1000:
        with suppress(OSError, ValueError):
            path = Path(value).expanduser().resolve()
            if path.is_file():
                yield (str(path), *_stamp(path))


def _stamp(path: Path) -> tuple[int, int]:
    """Bytes, and nanoseconds of the last change. Raises OSError."""
    about = path.stat()
    return about.st_size, about.st_mtime_ns
