"""What several benchmarks need: tables of rows, and a part for the word that names it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rhs import registry
from rhs.contracts import Context


def write(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """A CSV table with four figures of every float; the columns are those of the first row."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def odometry(word: str, context: Context) -> Any:
    """The part for `name:key=value,key=value`."""
    name, _, overrides = word.partition(":")
    cls = registry.load("odometry", name)
    values: dict[str, Any] = {}
    for item in filter(None, overrides.split(",")):
        key, _, text = item.partition("=")
        kind = type(getattr(cls(), key))
        values[key] = text in ("true", "True") if kind is bool else kind(text)
    return cls(**values).build(context)
