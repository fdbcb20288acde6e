"""Run folders -> one table. `python -m rhs.table FOLDER...` prints it.

A table is a view of row.json files; it can be made again at any time. Types do not depend on which runs are there:
text, Int64 (with missing values), float64, boolean.
"""

from __future__ import annotations

import argparse
import csv
import io
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rhs.base.commands import Arguments, answered, plain
from rhs.base.errors import ConfigError, RhsError
from rhs.config.dictionary import kind_of
from rhs.runfolder import shards
from rhs.runfolder.row import KEYS, column_rank, machine_dependent, read_row
from rhs.runfolder.row import canonical_hash as canonical_hash
from rhs.runfolder.row import write_row as write_row

from .cache import cache_of, one_sweep, read_cache, write_cache
from .columns import HASH, read_columns
from .varied_settings import varied_settings

if TYPE_CHECKING:
    import pandas

NUMBER = re.compile(r"[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|inf|nan)", re.IGNORECASE)
# A spreadsheet runs a cell that begins with one of these.
FORMULA = ("=", "+", "-", "@", "\t", "\r")


def find_rows(folders: Iterable[Path | str]) -> Iterator[Path]:
    """row.json files under the folders, in a fixed order; what an interrupted writer left is passed over."""
    return (path for path in _find(folders) if path.name == "row.json")


def _find(folders: Iterable[Path | str]) -> Iterator[Path]:
    """row.json files, and the folders (of sweeps, sensitivity, ...) whose rows are in shards (rhs.runfolder.shards)."""
    for folder in folders:
        if not Path(folder).is_dir():
            raise ConfigError(f"{folder} is not a folder; give run or sweep folders, for instance results/runs")
        for root, names, files in os.walk(folder):
            names[:] = sorted(n for n in names if ".tmp-" not in n)
            if "row.json" in (*files, *names):  # also a folder of that name: it is reported and not passed over
                yield Path(root) / "row.json"
            if shards.FOLDER in names and shards.shards(Path(root)):
                yield Path(root)


def rows(folders: Iterable[Path | str], *, unreadable: list[str] | None = None) -> pandas.DataFrame:
    """One row per run, sorted by what was run; the index `run` holds its folder.

    Settings that differ between the runs are columns too (`planner.samples`).
    A row.json that cannot be read is reported into `unreadable`; without that list it raises ConfigError.
    """
    paths = list({path.resolve(): path for path in _find(folders)}.values())  # a folder named twice counts once
    complaints: list[str] = []
    sweep = one_sweep(paths)
    cache = cache_of(sweep) if sweep else None
    table = read_cache(cache, paths, complaints) if cache else None
    if table is None:
        table = read_columns(sweep, paths, complaints) if sweep else None
        table = _row_by_row(paths, complaints) if table is None else table
        if cache:
            write_cache(cache, table, complaints)
    if unreadable is None and complaints:
        raise ConfigError(complaints[0])
    if unreadable is not None:
        unreadable += complaints
    return table


def _row_by_row(paths: Sequence[Path], complaints: list[str]) -> pandas.DataFrame:
    """The table of row.json files and of the shards of sweeps."""
    found, varied = _lines([path for path in paths if path.name != "row.json"], complaints)
    for path in [path for path in paths if path.name == "row.json" and str(path.parent) not in found]:
        try:
            found[str(path.parent)] = read_row(path)
        except RhsError as error:
            complaints.append(str(error))
    complaints += _odd_ones_out(found)
    varied |= varied_settings([folder for folder in found if folder not in varied]) if len(found) > 1 else {}
    return frame({folder: {**row, **varied.get(folder, {})} for folder, row in found.items()})


Rows = dict[str, dict[str, object]]


def _lines(sweeps: Iterable[Path], complaints: list[str]) -> tuple[Rows, Rows]:
    """Rows, and settings that were varied, of the runs that shards tell of; by what would be the run's folder."""
    found: Rows = {}
    varied: Rows = {}
    for sweep in sweeps:
        for line in shards.read_lines(shards.shards(sweep), complaints).values():
            folder = str(sweep / line.run)
            found[folder] = dict(line.row)
            varied[folder] = {key: value for key, value in line.set.items() if key not in line.row}
    return found, varied


def some_rows(folders: Iterable[Path | str], unreadable: list[str]) -> pandas.DataFrame:
    """The rows that can be read; complaints about others go into `unreadable`. Raises ConfigError when there are none."""
    table = rows(folders, unreadable=unreadable)
    where = ", ".join(map(str, folders))
    if not len(table) and unreadable:
        raise ConfigError(f"none of {len(unreadable)} row.json under {where} can be read; the first: {unreadable[0]}")
    if not len(table):
        raise ConfigError(f"no row.json under {where}; run `python -m rhs` first")
    return table


def _odd_ones_out(found: dict[str, dict[str, object]]) -> list[str]:
    """Take out rows that have text where most have a number, or the reverse; complaints."""
    complaints = []
    for name in sorted(name for name in {name for row in found.values() for name in row} if kind_of(name) != "word"):
        kinds = {type(row.get(name)) for row in found.values()} - {type(None)}
        if str not in kinds or len(kinds) == 1:
            continue
        text = [folder for folder, row in found.items() if isinstance(row.get(name), str)]
        other = [folder for folder, row in found.items() if row.get(name) is not None and folder not in set(text)]
        for folder in (text if len(text) <= len(other) else other) if text and other else ():
            complaints.append(f"{folder}/row.json: {name} is {found.pop(folder)[name]!r}, in other rows it is "
                              f"{'a number' if len(text) <= len(other) else 'text'}"[:180])
    return complaints


def frame(found: dict[str, dict[str, object]]) -> pandas.DataFrame:
    """DataFrame of named rows with fixed order and fixed types."""
    import pandas as pd

    columns = sorted({"status", "reason", *KEYS, *(name for row in found.values() for name in row)}, key=column_rank)
    order = _in_order(found)
    ordered = [found[run] for run in order]
    data = {name: _typed(name, [row.get(name) for row in ordered]) for name in columns}
    return pd.DataFrame(data, index=pd.Index(order, name="run", dtype="str"), columns=columns)


def _in_order(found: dict[str, dict[str, object]]) -> list[str]:
    """The runs by what was run; those that are alike in that by the hash of their configuration, then of their rows."""
    alike: dict[tuple, list[str]] = {}
    for run, row in found.items():
        alike.setdefault(tuple((isinstance(value, str), value if isinstance(value, int | float) else 0, str(value))
                               for value in map(row.get, (*KEYS, HASH))), []).append(run)
    return [run for key in sorted(alike) for run in
            (sorted(alike[key], key=lambda run: canonical_hash(found[run])) if len(alike[key]) > 1 else alike[key])]


def _typed(name: str, values: Sequence[object]):
    import pandas as pd

    known, kind = {type(value) for value in values} - {type(None)}, kind_of(name)
    if kind == "word" or str in known:
        return pd.array([None if v is None else str(v) for v in values], dtype="string")
    if known == {bool}:
        return pd.array(values, dtype="boolean")
    if kind == "count" or (known and known <= {int, bool} and not kind and not machine_dependent(name)):
        return pd.array([None if v is None else int(v) for v in values], dtype="Int64")  # type: ignore[call-overload]
    return pd.array([float("nan") if v is None else float(v) for v in values], dtype="float64")  # type: ignore[arg-type]


def to_csv(table: pandas.DataFrame, *, canonical: bool = False) -> str:
    """The table as text that reads back equal: full precision, empty for unknown and for empty text, LF; words that a
    reader could take for a number or a spreadsheet for a formula begin with an apostrophe.

    canonical: without the columns that depend on the machine, so that equal runs give equal bytes.
    """
    columns = [name for name in table.columns if not (canonical and machine_dependent(name))]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([_cell(name) for name in columns])
    writer.writerows(zip(*(_cells(table[name]) for name in columns), strict=True))
    return out.getvalue()


def _cells(column: pandas.Series) -> list[str]:
    """The values of a column as text; each word once, of which there are few."""
    if column.dtype == "float64":
        return ["" if value != value else repr(value) for value in column.tolist()]
    known = {value: _cell(value) for value in column.unique()}
    return [known[value] for value in column]


def _cell(value: object) -> str:
    import pandas as pd

    if value is None or value is pd.NA or (isinstance(value, float) and value != value):
        return ""
    if isinstance(value, str):
        return f"'{value}" if _doubtful(value) else value
    if str(value) in ("True", "False"):
        return str(value).lower()
    return repr(float(value)) if isinstance(value, float) else str(value)


def _doubtful(word: str) -> bool:
    taken = word in ("true", "false") or NUMBER.fullmatch(word) is not None
    return taken or word.startswith((*FORMULA, "'"))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a summary of run folders. Exit code 0; 1 not possible; 2 for a wrong request; 3 when a row could not be read."""
    parser = Arguments(prog="python -m rhs.table", description="The table of run folders.")
    parser.add_argument("folders", nargs="+", type=Path, help="run or sweep folders, searched through")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write every row and column here")
    parser.add_argument("--canonical", type=Path, metavar="FILE",
                        help="the same without times and memory: equal runs give equal bytes")
    parser.add_argument("--parquet", type=Path, metavar="FILE", help="the same as --csv, with types (needs pyarrow)")
    parser.add_argument("--latex", type=Path, metavar="FILE", help="write what is printed as a LaTeX table (booktabs)")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write what is printed as a Markdown table")
    parser.add_argument("--group", default="", help="columns to group by, comma-separated; default: those that vary")
    parser.add_argument("--columns", default="", help="columns to summarise, comma-separated")
    parser.add_argument("--compare", default="", metavar="PART_OR_SETTING",
                        help="paired differences between its values (planner, source.image_width, ...), all else equal")
    parser.add_argument("--cluster", default="", metavar="COLUMN",
                        help="what intervals and tests take the runs for samples of: world, ..., or run; default: worlds "
                             "where a line holds several, else problems, else runs")
    parser.add_argument("--rows", action="store_true", help="print every run instead of a summary")
    return answered(lambda: _print_table(parser.parse_args(arguments)))


def _print_table(chosen: argparse.Namespace) -> int:
    from .export import as_latex, as_markdown, write_parquet, write_text
    from .summary import as_text

    unreadable: list[str] = []
    table = some_rows(chosen.folders, unreadable)
    view = _view(table, chosen)
    for path, canonical in ((chosen.csv, False), (chosen.canonical, True)):
        if path:
            write_text(path, to_csv(table, canonical=canonical))
    if chosen.parquet:
        write_parquet(table, chosen.parquet)
    for path, text in ((chosen.latex, as_latex), (chosen.markdown, as_markdown)):
        if path:
            write_text(path, text(view))
    sys.stdout.write(as_text(view) + "\n")
    return tell_unreadable(unreadable)


def _view(table: pandas.DataFrame, chosen: argparse.Namespace) -> pandas.DataFrame:
    """What was asked for: pairs, every run, or a summary."""
    from .compare import compare
    from .observations import judged
    from .summary import listing, shown, summarise

    group, columns = _words(chosen.group), _words(chosen.columns)
    if chosen.compare:
        return compare(table, chosen.compare, columns or shown(judged(table)), cluster=chosen.cluster)
    return listing(table, columns) if chosen.rows else summarise(table, group=group, columns=columns, cluster=chosen.cluster)


def tell_unreadable(messages: Sequence[str], most: int = 20) -> int:
    """Name the rows that were left out, a line each; exit code 3 when there are any."""
    for number, message in enumerate(messages[:most], 1):
        sys.stderr.write(plain(f"not counted ({number} of {len(messages)}): {message}") + "\n")
    if len(messages) > most:
        sys.stderr.write(f"not counted: {len(messages) - most} more\n")
    return 3 if messages else 0


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
