"""The table of a large sweep as Parquet beside its shards, made when it is first read, where pyarrow is installed.

Its name holds a checksum of the shards' names and sizes: with a row more it is no longer looked at. It may be deleted.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rhs.api.files import write_whole
from rhs.base.errors import RhsError
from rhs.runfolder import shards

if TYPE_CHECKING:
    import pandas

FROM_ROWS = 10_000  # below, reading the shards is quick enough
LEAST_BYTES = 200  # of a line
COMPLAINTS = "complaints"


def one_sweep(paths: Sequence[Path]) -> Path | None:
    """The sweep that what was found under the folders asked for belongs to, if it is large; else None."""
    sweeps = [path for path in paths if path.name != "row.json"]
    if len(sweeps) != 1 or any(path.parent.parent != sweeps[0] for path in paths if path.name == "row.json"):
        return None
    large = sum(path.stat().st_size for path in shards.shards(sweeps[0])) >= FROM_ROWS * LEAST_BYTES
    return sweeps[0] if large else None


def cache_of(sweep: Path) -> Path:
    """Where the table of the shards as they are now is kept."""
    listing = "".join(f"{path.name} {path.stat().st_size}\n" for path in shards.shards(sweep))
    return sweep / shards.FOLDER / f"table-{zlib.crc32(listing.encode()):08x}.parquet"


def write_cache(cache: Path, table: pandas.DataFrame, complaints: Sequence[str]) -> None:
    """Keep the table in place of older ones. cache: what `cache_of` said before the shards were read. Does nothing where
    the table is small, pyarrow is missing or nothing may be written."""
    if len(table) < FROM_ROWS:
        return
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        return
    named = table.set_axis([Path(run).name for run in table.index])
    named.attrs[COMPLAINTS] = list(complaints)
    with suppress(OSError, RhsError):
        for old in cache.parent.glob("table-*.parquet"):
            old.unlink(missing_ok=True)
        write_whole(cache, lambda partial: named.to_parquet(partial, engine="pyarrow", index=True))


def read_cache(cache: Path, paths: Sequence[Path], complaints: list[str]) -> pandas.DataFrame | None:
    """The table that was kept; None where there is none, or where a run folder that was found is not in it."""
    if not cache.is_file():
        return None
    import pandas as pd

    try:
        table = pd.read_parquet(cache)
    except Exception:  # no pyarrow, or a file that is no table: the shards have it all
        return None
    if not {path.parent.name for path in paths if path.name == "row.json"} <= set(table.index):
        return None
    complaints += table.attrs.pop(COMPLAINTS, [])
    return table.set_axis(pd.Index([f"{cache.parent.parent}/{run}" for run in table.index], name="run", dtype="str"))
