"""`python -m rhs verify`: run it again and say whether the numbers are the same.

    python -m rhs verify RUN|SWEEP ...        every run in these folders, from its config.yaml; nothing there is changed
        --sample N --seed S                   only N of them, drawn
        --tolerance 1e-6                      differences of this share of a value count as the same (0)
        --jobs N                              processes at a time (one per core)
    python -m rhs verify --golden FOLDER      the jobs of FOLDER/jobs.yaml against the rows kept in FOLDER
        --update                              keep the rows of now instead

What is equal in every bit, what within 1e-6, and what else differs is said for each run, column by column; columns of the
machine (times, memory, versions) are left out. Exit code 0: the same; 2 refused; 3: something differs.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rhs.base.commands import answered, plain
from rhs.base.errors import ConfigError, PluginError
from rhs.base.strict_yaml import load_yaml
from rhs.config.compose import RunConfig, compose_config, config_hash, from_plain
from rhs.runfolder.row import machine_dependent, read_row, write_row
from rhs.sweeps.jobs import Job, Limits, processors, run_jobs
from rhs.sweeps.runs import rows_of, values_of

from .arguments import JOBS, Number, parse

CLASSES = ("equal", "within 1e-6", "other")
CLOSE = 1e-6
UNFINISHED = ("running", "killed", "timeout", "interrupted")  # ended from outside: another run need not end there
LEFT_OUT = ("config_hash",)  # in golden rows: every new setting changes it


@dataclass(frozen=True)
class Difference:
    """One column of two rows. share: of the larger value; infinite between values that are no numbers."""

    column: str
    before: object
    now: object
    share: float

    @property
    def kind(self) -> str:
        return CLASSES[1] if self.share <= CLOSE else CLASSES[2]

    def __str__(self) -> str:
        share = f" ({self.share:.1g} of it)" if math.isfinite(self.share) else ""
        return plain(f"{self.column}: {_shown(self.before)} -> {_shown(self.now)}{share}")


def differences(before: Mapping[str, object], now: Mapping[str, object]) -> list[Difference]:
    """The columns in which two rows differ, the machine's left out. An absent column is an unknown value."""
    names = sorted(name for name in {**before, **now} if not machine_dependent(name))
    found = [Difference(name, before.get(name), now.get(name), _share(before.get(name), now.get(name))) for name in names]
    return [one for one in found if one.share > 0.0]


def _share(a: object, b: object) -> float:
    """How far two values are apart, as a share of the larger; 0 where they are the same."""
    a, b = (None if isinstance(v, float) and math.isnan(v) else v for v in (a, b))
    if a == b and isinstance(a, bool) == isinstance(b, bool):
        return 0.0
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in (a, b)):
        return math.inf
    return abs(a - b) / max(abs(a), abs(b))  # type: ignore[operator, arg-type]


def _shown(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)[:60]


def main(arguments: Sequence[str] = ()) -> int:
    """The command."""
    return answered(lambda: _checked(arguments))


def _checked(words: Sequence[str]) -> int:
    chosen = parse("verify", __doc__, words, sample=Number(0, low=0, high=1_000_000), seed=Number(0, low=0, high=2**63 - 1),
                   tolerance=Number(0.0, low=0.0, high=1.0), jobs=JOBS, golden="", update=False)
    if bool(chosen.typed) == bool(chosen.golden):
        raise ConfigError("give run or sweep folders, or --golden FOLDER")
    return _golden(chosen) if chosen.golden else _verify(chosen)


def _verify(chosen: argparse.Namespace) -> int:
    """Run folders again, and compare."""
    found = rows_of([Path(word) for word in chosen.typed])
    rows = {folder: row for folder, row in found.items() if row.get("status") not in UNFINISHED}
    if not rows:
        raise ConfigError("no finished run in these folders")
    drawn = _drawn(sorted(rows), chosen)
    loose = " ".join(sorted({str(rows[folder].get("plugins") or "") for folder in drawn})).strip()
    try:
        configs = {str(folder): from_plain(values) for folder, values in values_of(drawn).items()}
    except PluginError as error:
        raise PluginError(f"these runs have {loose}: add --plugin FILE" if loose else str(error)) from error
    return _compare({name: rows[Path(name)] for name in configs}, again(configs, chosen.jobs), chosen.tolerance)


def _drawn(folders: list[Path], chosen: argparse.Namespace) -> list[Path]:
    if not chosen.sample or chosen.sample >= len(folders):
        return folders
    picked = np.random.default_rng(chosen.seed).choice(len(folders), chosen.sample, replace=False)
    return [folders[k] for k in sorted(picked)]


def _golden(chosen: argparse.Namespace) -> int:
    """The jobs of a golden set against the rows that are kept of them."""
    folder = Path(chosen.golden).absolute()
    if not (folder / "jobs.yaml").is_file():
        raise ConfigError(f"--golden {chosen.golden}: holds no jobs.yaml; expected it, lines `name: [word, ...]`, and "
                          "beside it NAME/row.json of each (--update writes these)")
    words = load_yaml(folder / "jobs.yaml")
    if not isinstance(words, dict) or not all(isinstance(w, list) for w in words.values()):
        raise ConfigError(f"{folder}/jobs.yaml: expected lines `name: [word, word, ...]`")
    with contextlib.chdir(folder):
        configs = {name: compose_config([str(word) for word in typed]) for name, typed in words.items()}
        before = {} if chosen.update else {name: read_row(folder / name / "row.json") for name in configs}
        now = again(configs, chosen.jobs)
    kept = {name: {column: row[column] for column in row
                   if (not machine_dependent(column) or column == "versions") and column not in LEFT_OUT}
            for name, row in now.items()}
    if chosen.update:
        for name, row in kept.items():
            (folder / name).mkdir(exist_ok=True)
            write_row(folder / name, row)
        sys.stdout.write(f"{len(kept)} rows kept in {folder}\n")
        return 0
    return _compare(before, kept, chosen.tolerance)


def again(configs: Mapping[str, RunConfig], jobs: int) -> dict[str, dict[str, object]]:
    """The rows of these configurations, run now, each in a process of its own and in a folder that does not last."""
    planned = {}
    for config in configs.values():
        bare = replace(config, output="", overwrite=False, recording="off", pictures="off", video=False, live="",
                       ahead="off")
        planned[config_hash(config)] = Job(f"again_{config_hash(config)}", bare, ())
    with tempfile.TemporaryDirectory(prefix="rhs-verify-") as folder:
        run_jobs(list(planned.values()), Path(folder), Limits(jobs or processors()), tell=lambda job, status: None)
        rows = {key: read_row(Path(folder) / job.name / "row.json") for key, job in planned.items()}
    return {name: rows[config_hash(config)] for name, config in configs.items()}


def _compare(before: Mapping[str, Mapping[str, object]], now: Mapping[str, Mapping[str, object]], tolerance: float) -> int:
    """Say of each run how its row of now differs from the one before; the exit code."""
    worst = 0.0
    counts = dict.fromkeys(CLASSES, 0)
    for name, row in before.items():
        found = sorted(differences(row, now[name]), key=lambda one: -one.share)
        columns = sum(not machine_dependent(column) for column in row)
        kind = found[0].kind if found else CLASSES[0]
        counts[kind] += 1
        worst = max([worst, *(one.share for one in found)])
        sys.stdout.write(f"{name}: {kind}, {columns - len(found)} of {columns} columns equal\n")
        sys.stdout.writelines(f"  {line}\n" for line in _lines(found))
        if found and (others := made_otherwise(str(row.get("versions") or ""), str(now[name].get("versions") or ""))):
            sys.stdout.write(f"  {others}\n")
    summary = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    sys.stdout.write(f"{len(before)} runs: {summary}\n")
    return 3 if worst > tolerance else 0


def made_otherwise(before: str, now: str) -> str:
    """Which versions (`name=version ...`) differ; empty where none does or those of before are not known."""
    was, is_ = before.split(), now.split()
    gone, here = ([one for one in these if one not in those] for these, those in ((was, is_), (is_, was)))
    return f"made with {' '.join(gone)}; here {' '.join(here)}" if gone and here else ""


def _lines(found: Sequence[Difference]) -> Iterator[str]:
    yield from map(str, found[:10])
    if len(found) > 10:
        yield f"and {len(found) - 10} more"
