"""`python -m rhs bench corridor-v1 | home-v1 | recordings-v1`: frozen buildings or recordings (`rhs.cli.bench`)."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.base.errors import ConfigError

from .arguments import going_on
from .arguments import limits as limits_of

if TYPE_CHECKING:
    from rhs.sweeps.jobs import Job, Limits
    from rhs.sweeps.suite import Suite

HOME = Path("results") / "bench"
RUNS = Path("results") / "sweeps"
Table = tuple[list[dict[str, str]], dict[str, dict[str, Any]]]  # rows, and how they were made


def main(chosen: argparse.Namespace, words: Sequence[str]) -> int:
    """The command. Exit code 0; 3 when a run of it left no row."""
    from rhs.sweeps.suite import SUITES, jobs_of

    suite = _frozen(SUITES[chosen.set])
    combinations, mine = _combinations(suite, chosen)
    suite, note = _part(suite, chosen)
    output = chosen.output or str(RUNS / "_".join([suite.name, *["mine"] * bool(mine), *["quick"] * chosen.quick]))
    data = _data(suite, chosen, combinations)
    jobs = {name: jobs_of(typed, suite.asked(typed), data) for name, typed in combinations.items()}
    combinations = {name: typed for name, typed in combinations.items() if jobs[name]}
    with going_on(output) as folder:
        limits = limits_of(chosen)
        rows, made = _made(suite, combinations, jobs, folder=folder, limits=limits)
        for name, record in made.items():
            record |= {"words": combinations[name], "command": shown(words)}
        whole = not (mine or chosen.quick or chosen.held_out)
        table = (rows, made) if whole and not _kept(suite) else _beside(suite, rows, made)
        folders = [folder, *([HOME] if whole and not chosen.output else [])]
        text = _published(suite, table, folders, note, mine)
        if not suite.recorded:
            text += "\n" + _more(suite, combinations, jobs, folders=folders, limits=limits, blame=chosen.blame)
        if chosen.entry:
            _entry(jobs, folder, Path(chosen.entry))
    sys.stdout.write(f"{text}\nfiles: {folder}\n")
    return 0 if all(row["status"] not in ("missing", "killed", "timeout") for row in rows) else 3


def _frozen(suite: Suite) -> Suite:
    """The suite, unless its buildings have changed. Raises ConfigError."""
    from rhs.sweeps.suite import digest

    if (found := digest(suite)) != suite.frozen:
        raise ConfigError(f"bench {suite.name}: found buildings and questions {found}, expected {suite.frozen}: they have "
                          f"changed, which makes another version")
    return suite


def _combinations(suite: Suite, chosen: argparse.Namespace) -> tuple[dict[str, str], str]:
    """Name -> words of what is to be run; the name of mine, empty where there is none. Raises ConfigError."""
    from rhs.sweeps.suite import usable

    if chosen.mine:
        words = " ".join([chosen.mine, *chosen.words])
        return {words: words}, words
    if chosen.words or chosen.only:
        raise ConfigError(f"bench: {'--only' if chosen.only else chosen.words[0]}: say whose: --mine odometry=NAME")
    names = [name for name in chosen.ours.split(",") if name] or list(suite.ours)
    if unknown := [name for name in names if name not in suite.ours]:
        raise ConfigError(f"bench --ours {unknown[0]}: there is {', '.join(suite.ours)}")
    good, bad = usable({name: suite.ours[name] for name in names}, suite)
    for name, why in bad.items():
        sys.stderr.write(f"rhs: {name} is left out: {why}\n")
    return good, ""


def _part(suite: Suite, chosen: argparse.Namespace) -> tuple[Suite, str]:
    """The suite, or the part of it that was asked for, or its held-out buildings; a note for the page."""
    from rhs.sweeps.suite import revealed

    if chosen.held_out:
        return replace(suite, buildings=revealed(suite.name, Path(chosen.held_out))), "Held-out buildings, now revealed."
    if chosen.quick:
        return replace(suite, buildings=suite.quick()), "Quick: the first building of each family; no entry."
    return suite, ""


def shown(words: Sequence[str]) -> str:
    """The command as it is handed on: where somebody's recordings and runs lie is nobody else's business."""
    kept = ["--data=FOLDER" if word.startswith("--data=") else "FOLDER" if before == "--data" else word
            for before, word in zip(["", *words], words, strict=False) if not word.startswith("output=")]
    return " ".join(["python -m rhs bench", *kept])


def _data(suite: Suite, chosen: argparse.Namespace, combinations: Mapping[str, str]) -> Path | None:
    """Where the recordings lie that the combinations are asked about; None for buildings. Raises ConfigError."""
    from rhs.sweeps.recorded import check_data

    if not suite.recorded:
        if chosen.data:
            raise ConfigError(f"bench {suite.name}: --data is for recordings-v1")
        return None
    if chosen.held_out or chosen.blame:
        raise ConfigError(f"bench {suite.name}: --held-out and --blame are for buildings")
    data = Path(chosen.data or os.environ.get("RHS_DATA", "data"))
    check_data(data, list(dict.fromkeys(name for words in combinations.values() for name, _ in suite.asked(words))))
    return data


def _made(suite: Suite, combinations: Mapping[str, str], jobs: Mapping[str, Sequence[Job]], *, folder: Path,
          limits: Limits) -> Table:
    """Run what has not ended yet, under one progress bar."""
    from rhs.sweeps import recorded
    from rhs.sweeps.kept import kept_rows
    from rhs.sweeps.suite import cells_of, times_of

    from .progress import running

    every = [job for several in jobs.values() for job in several]
    with running(len(every)) as tell:
        found = kept_rows(every, folder, limits, tell=tell)
    rows, made, left = [], {}, iter(zip(every, found, strict=True))
    for name, words in combinations.items():
        some = [next(left) for _ in jobs[name]]
        for building, (job, row) in zip(suite.asked(words), some, strict=True):
            rows.append(recorded.cells_of(name, building[0], row, folder / job.name) if suite.recorded
                        else cells_of(name, building, row))
        made[name] = times_of([row for _, row in some])
    return rows, made


def _more(suite: Suite, combinations: Mapping[str, str], jobs: Mapping[str, Sequence[Job]], *, folders: Sequence[Path],
          limits: Limits, blame: bool) -> str:
    """NAME_more.csv and NAME_more.md into the folders, beside the runs first; the page. Blamed are the runs that lost
    something."""
    from rhs.reports.export import write_texts
    from rhs.sweeps import suite_more
    from rhs.sweeps.kept import any_row, kept_rows
    from rhs.sweeps.suite import csv_of, jobs_of

    from .progress import running

    runs = [(name, building, any_row(folders[0] / job.name), folders[0] / job.name) for name, words in combinations.items()
            for building, job in zip(suite.asked(words), jobs[name], strict=True)]
    again = {(name, building): jobs_of(combinations[name], [building], more="task=blame processes=1")[0]
             for name, building, row, _ in runs if blame and suite_more.lost(row)}
    found: dict[tuple[str, tuple[str, int]], dict[str, Any]] = {}
    if again:
        with running(len(again)) as tell:
            some = kept_rows(list(again.values()), folders[0] / "blame", limits, tell=tell)
            found = dict(zip(again, some, strict=True))
    rows = [suite_more.cells_of(name, building, row, found.get((name, building)), folder)
            for name, building, row, folder in runs]
    text = suite_more.page(suite.name, rows)
    for folder in folders:
        write_texts(folder, {f"{suite.name}_more.csv": csv_of(rows, suite_more.CELLS), f"{suite.name}_more.md": text})
    return text


def _kept(suite: Suite) -> Path | None:
    """The folder of the table that is checked in: under this folder, or beside the program."""
    for folder in (HOME, Path(__file__).resolve().parents[2] / HOME):
        if (folder / f"{suite.name}.csv").is_file():
            return folder
    return None


def _beside(suite: Suite, rows: list[dict[str, str]], made: dict[str, dict[str, Any]]) -> Table:
    """These rows, and those of the checked-in table in the same buildings; new rows take the place of old ones."""
    from rhs.sweeps.suite import read_csv

    if (folder := _kept(suite)) is None:
        return rows, made
    try:
        old = read_csv((folder / f"{suite.name}.csv").read_text("utf-8"), suite.cells)
        old_made = json.loads((folder / f"{suite.name}.json").read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"{folder}/{suite.name}.csv, .json: {error}") from error
    buildings = {world for world, _ in suite.buildings}
    kept = [row for row in old if row["combination"] not in made and row["building"] in buildings
            and (row["building"], int(row["seed"])) in suite.buildings]
    return [*kept, *rows], {row["combination"]: old_made.get(row["combination"], {}) for row in kept} | made


def _published(suite: Suite, table: Table, folders: Sequence[Path], note: str, mine: str) -> str:
    """NAME.csv, NAME.json and NAME.md into the folders; the page."""
    from rhs.reports.export import write_texts
    from rhs.sweeps.suite import csv_of
    from rhs.sweeps.suite_page import page

    rows, made = table
    text = page(suite, rows, made, note=note, mine=mine)
    for folder in folders:
        write_texts(folder, {f"{suite.name}.csv": csv_of(rows, suite.cells), f"{suite.name}.md": text,
                             f"{suite.name}.json": json.dumps(made, indent=1) + "\n"})
    return text


def _entry(jobs: Mapping[str, Sequence[Job]], runs: Path, entry: Path) -> None:
    """What `rhs verify` needs of each run, and nothing else: config.yaml and row.json."""
    for job in (job for several in jobs.values() for job in several):
        (entry / job.name).mkdir(parents=True, exist_ok=True)
        for name in ("config.yaml", "row.json"):
            if (runs / job.name / name).is_file():
                shutil.copyfile(runs / job.name / name, entry / job.name / name)
