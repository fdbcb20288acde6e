"""Tables for papers and other programs: LaTeX and Markdown of what is printed, parquet of every row and column, JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.api.files import replacing, write_whole
from rhs.base.errors import ConfigError

from .summary import notes_of, short

if TYPE_CHECKING:
    import pandas

LONGEST = 500  # characters of a cell


def as_latex(view: pandas.DataFrame) -> str:
    """A booktabs table (\\usepackage{booktabs}), special characters escaped, its notes as comments."""
    words = view.map(lambda value: short(value, LONGEST))
    return "".join(f"% {note}\n" for note in notes_of(view)) + words.to_latex(index=False, escape=True)


def as_markdown(view: pandas.DataFrame) -> str:
    """A table for a README, its notes below."""
    rows = [list(map(str, view.columns)), ["---"] * len(view.columns)]
    rows += [[short(value, LONGEST).replace("|", "/") for value in row] for row in view.itertuples(index=False, name=None)]
    notes = "".join(f"\n{note}\n" for note in notes_of(view))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + f"\n{notes}"


def write_text(path: Path, text: str) -> None:
    """Write a table's text, whole or not at all."""
    with replacing(path) as file:
        file.write(text)


def write_texts(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files of these names into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_text(folder / name, text)


def without_nan(value: Any) -> Any:
    """The value with NaN and infinity, which JSON does not know, as null."""
    if isinstance(value, dict):
        return {name: without_nan(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_parquet(table: pandas.DataFrame, path: Path) -> None:
    """Every row and column with its type, the folder of each run as the column `run`. Needs pyarrow."""
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise ConfigError("--parquet needs pyarrow, which is not installed; type: pip install 'rhs[parquet]'") from None
    flat = table.reset_index()
    write_whole(path, lambda partial: flat.to_parquet(partial, engine="pyarrow", index=False))
