"""The table of a large sweep as Parquet beside its shards, made at its end where pyarrow is installed; it may be deleted.

Its name holds a checksum of the shards' names and sizes: with a row more it is no longer looked at.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rhs.api.files import write_whole
from rhs.runfolder import shards

if TYPE_CHECKING:
    import pandas

FROM_ROWS = 10_000  # below, reading the shards is quick enough


def write_cache(sweep: Path, table: pandas.DataFrame) -> None:
    """Keep the table of a sweep all of whose rows are in shards. Does nothing where it is small or pyarrow is missing."""
    if len(table) < FROM_ROWS or not (sweep / shards.FOLDER).is_dir():
        return
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        return
    named = table.set_axis([Path(run).name for run in table.index])
    for old in (sweep / shards.FOLDER).glob("table-*.parquet"):
        old.unlink(missing_ok=True)
    write_whole(_cache(sweep), lambda partial: named.to_parquet(partial, engine="pyarrow", index=True))


def read_cache(paths: Sequence[Path]) -> pandas.DataFrame | None:
    """The table of one sweep, given what was found under the folders asked for; None where it is not all of it."""
    sweeps = [path for path in paths if path.name != "row.json"]
    if len(sweeps) != 1 or not _cache(sweeps[0]).is_file():
        return None
    import pandas as pd

    try:
        table = pd.read_parquet(_cache(sweeps[0]))
    except Exception:  # no pyarrow, or a file that is no table: the shards have it all
        return None
    rows = [path.parent for path in paths if path.name == "row.json"]
    if any(folder.parent != sweeps[0] for folder in rows) or not {folder.name for folder in rows} <= set(table.index):
        return None
    return table.set_axis(pd.Index([str(sweeps[0] / run) for run in table.index], name="run", dtype="str"))


def _cache(sweep: Path) -> Path:
    told = "".join(f"{path.name} {path.stat().st_size}\n" for path in shards.shards(sweep))
    return sweep / shards.FOLDER / f"table-{zlib.crc32(told.encode()):08x}.parquet"
