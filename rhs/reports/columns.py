"""The table of a large sweep from its shards by pyarrow, column by column: what `rhs.reports.table.rows` makes row by row.

What is not plain is left to that: a column of text and numbers, a run folder that no shard tells of, runs alike in all that
was chosen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.config.dictionary import kind_of
from rhs.runfolder import shards
from rhs.runfolder.row import KEYS, column_rank, machine_dependent

if TYPE_CHECKING:
    import pandas

HASH = "config_hash"  # by it the runs are ordered that are alike in KEYS


def read_columns(sweep: Path, paths: Sequence[Path], complaints: list[str]) -> pandas.DataFrame | None:
    """The table of a sweep; None where it has to be read row by row. paths: row.json files that were found in it."""
    try:
        import pyarrow as pa
        import pyarrow.json
    except ImportError:
        return None
    torn: list[str] = []
    last = {shards.key_of(line): line for path in shards.shards(sweep) for line in shards.lines_of(path, torn)}
    text = "\n".join(last.values()).encode()
    try:
        lines = pyarrow.json.read_json(pa.BufferReader(text), read_options=pyarrow.json.ReadOptions(block_size=4 << 20))
        del text, last
        table = _table(lines, sweep, {path.parent.name for path in paths if path.name == "row.json"})
    except (pa.ArrowException, KeyError, OverflowError):
        return None
    if table is not None:
        complaints += torn
    return table


def _table(lines: Any, sweep: Path, folders: set[str]) -> pandas.DataFrame | None:
    """The same from the lines as a table of Arrow's. Raises where a value is not what its column takes."""
    import pandas as pd
    import pyarrow as pa

    runs = lines["run"]
    row, given = ({name.partition(".")[2]: column for name, column in zip(flat.column_names, flat.columns, strict=True)}
                  for flat in (lines.select([part]).flatten() for part in ("row", "set")))
    if row["status"].null_count or not folders <= set(runs.to_pylist()) or set(row) & set(given):
        return None
    columns = row | given
    order = _order(columns)
    if order is None or len(runs.unique()) < len(runs):
        return None
    empty = pa.chunked_array([pa.nulls(len(runs))])
    names = sorted({"status", "reason", *KEYS, *columns}, key=column_rank)
    data = {name: _typed(name, columns.get(name, empty)).take(order) for name in names}
    index = pd.Index([f"{sweep}/{run}" for run in runs.take(order).to_pylist()], name="run", dtype="str")
    return pd.DataFrame(data, index=index, columns=names)


def _order(columns: Mapping[str, Any]) -> np.ndarray | None:
    """(N,) numbers of the rows as a table has them: by KEYS, then by their hashes; None where two are alike in all."""
    import pandas as pd

    places = []
    for name in (*KEYS, HASH):
        if name == "seed" and name in columns and columns[name].null_count:
            return None
        if name in columns:
            places.append(pd.factorize(_typed(name, columns[name]), sort=True)[0])
    order = np.lexsort(places[::-1])
    alike = np.all([place[order][1:] == place[order][:-1] for place in places], axis=0)
    return None if alike.any() else order


def _typed(name: str, column: Any) -> Any:
    """A column with the type that `rhs.reports.table` gives it. Raises pyarrow.ArrowException where it does not take it."""
    import pandas as pd
    import pyarrow as pa

    kind, found = kind_of(name), column.type
    if pa.types.is_string(found) or kind == "word":
        if not (pa.types.is_string(found) or pa.types.is_null(found)):
            raise pa.ArrowInvalid(f"{name}: expected text")
        return pd.StringDtype().__from_arrow__(column.cast(pa.string()))
    if pa.types.is_boolean(found):
        return pd.BooleanDtype().__from_arrow__(column)
    if not (pa.types.is_null(found) or pa.types.is_integer(found) or pa.types.is_floating(found)):
        raise pa.ArrowInvalid(f"{name}: expected a number")
    if kind == "count" or (pa.types.is_integer(found) and not kind and not machine_dependent(name)):
        return pd.Int64Dtype().__from_arrow__(column.cast(pa.int64()))
    return column.cast(pa.float64()).to_numpy()
