"""The runs under some folders, whether a folder of theirs was kept or a shard has their row: what to ask of them again.

A run is named by its folder; one that left none, by the folder it would have: SWEEP/NAME, as in the table.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rhs.base.errors import ConfigError
from rhs.config.compose import Composer, config_hash, read_values, to_plain
from rhs.reports.table import find_rows
from rhs.runfolder.row import read_row
from rhs.runfolder.shards import read_lines, shards, words_key

from .sweep import job_of, plan, recall


def rows_of(folders: Iterable[Path]) -> dict[Path, dict[str, object]]:
    """The row of each run; jobs that were refused before they began are left out where no folder tells of them."""
    folders = list(folders)
    return rows_in_shards(folders) | {path.parent: read_row(path) for path in find_rows(folders)}


def rows_in_shards(folders: Iterable[Path]) -> dict[Path, dict[str, object]]:
    """The same of those that shards tell of."""
    rows: dict[Path, dict[str, object]] = {}
    for sweep in sorted({path.parent for folder in folders for path in Path(folder).rglob("sweep.json")}):
        for line in read_lines(shards(sweep), []).values():
            if line.row.get("config_hash"):
                rows[sweep / line.run] = dict(line.row)
    return rows


def values_of(runs: Iterable[Path]) -> dict[Path, dict[str, Any]]:
    """The configuration of each run as plain values: from its config.yaml, else composed again from the words of its
    sweep. Raises ConfigError, in one line, for what is neither and for words that mean something else by now."""
    runs = list(runs)
    found = {run: read_values(run) for run in runs if (run / "config.yaml").is_file()}
    for sweep in {run.parent for run in runs if run not in found}:
        found |= _composed(sweep, {run.name for run in runs if run not in found and run.parent == sweep})
    return {run: found[run] for run in runs}


def _composed(sweep: Path, names: set[str]) -> dict[Path, dict[str, Any]]:
    """The same of runs of which a shard of this sweep has the row."""
    lines = {line.words: line for line in read_lines(shards(sweep), []).values() if line.run in names}
    unknown = names - {line.run for line in lines.values()}
    if unknown and (one := sweep / min(unknown)) and (one / "sweep.json").is_file():
        raise ConfigError(f"{one} is a sweep; name one of its runs (python -m rhs table {one} --rows lists them)")
    if unknown:
        raise ConfigError(f"{sweep / min(unknown)}: no run folder (no config.yaml), and no row of that name in {sweep}/rows")
    before = recall(sweep)
    conf = tuple(map(Path, before["conf"]))
    planned = plan([word for word in before["words"] if not word.startswith("output=")], conf)
    composer, found = Composer(conf), {}
    for index in range(len(planned.combinations)):
        line = lines.get(words_key(planned.combinations.texts(index)))
        if line is None:
            continue
        words = planned.combinations[index]
        config = job_of(composer.config(words), words, planned.swept).config
        if config_hash(config) != line.row.get("config_hash"):
            raise ConfigError(f"{sweep / line.run}: its words give another configuration now than when it ran")
        found[sweep / line.run] = to_plain(config)
    if lost := names - {run.name for run in found}:
        raise ConfigError(f"{sweep / min(lost)}: the words in {sweep}/sweep.json do not give this run")
    return found
