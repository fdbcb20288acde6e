"""`python -m rhs card localiser=mine source=replay source.path=...`: the card on recordings of somebody's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rhs.base.errors import ConfigError, PluginError
from rhs.card import recordings
from rhs.card.card import Card, about, of_contract
from rhs.config import registry
from rhs.reports.export import without_nan
from rhs.sweeps.job import Job, Limits
from rhs.sweeps.jobs import processors
from rhs.sweeps.kept import kept_rows
from rhs.sweeps.sweep import plan

from .progress import running

RUNS = "runs"  # below the folder of the card


def card_on(kind: str, name: str, settings: Any, own: Sequence[str], question: Sequence[str], folder: Path) -> Card:
    """The card of `kind=name` on recordings. own: the words of its settings; question: all others. The runs stay in
    folder/runs: typed again, those that ended are not run again. Raises ConfigError, before anything runs."""
    if kind not in recordings.COLUMNS:
        raise ConfigError(f"card {kind}={name}: on recordings there are cards of {' and '.join(recordings.COLUMNS)}; leave "
                          "out source=, for its card on the standard set")
    jobs, why_not = jobs_of(kind, name, own, question)
    mine, runs = f"{kind}={name}", folder / RUNS
    rows = _rows(jobs[mine], runs)
    if all(row["status"] == "refused" for row in rows.values()):
        raise ConfigError(str(next(iter(rows.values()))["reason"]))
    rows |= _rows([job for part, each in jobs.items() if part != mine for job in each], runs)
    found = {part: [_row(kind, rows, one, None if part == mine else own_one, runs)
                    for one, own_one in zip(each, jobs[mine], strict=True)] for part, each in jobs.items()}
    broken = [part for part, each in found.items() if part != mine and all(row["status"] != "ok" for row in each)]
    why_not |= {part: str(found[part][0].get("reason") or found[part][0]["status"]) for part in broken}
    found = {part: each for part, each in found.items() if part not in broken}
    own_rows = dict(zip(called(jobs[mine]), found[mine], strict=True))
    content = about(kind, name, settings)
    content |= {
        "set_title": "On your recordings", "standard_set": f"python -m rhs -m {' '.join(typed(kind, question))}",
        "columns": recordings.meanings(kind), "rooms_title": "Recording by recording",
        "figures": {part: recordings.figures(kind, each) for part, each in found.items()},
        "rooms": {one: recordings.figures(kind, [row]) for one, row in own_rows.items()},
        "verdict": [of_contract(content), *recordings.sentences(kind, own_rows),
                    *(f"not beside it, {part}: {why.partition('; type')[0]}" for part, why in why_not.items())],
        "passes": all(each["holds"] for each in content["contract"])
        and all(row["status"] == "ok" for row in own_rows.values())}
    shown = {part: [runs / job.name for job in jobs[part]] for part in found}
    return Card(without_nan(content), pictures=recordings.pictures(kind, mine, shown))


def _rows(jobs: Sequence[Job], folder: Path) -> dict[str, Any]:
    """The row of each run by name, under a bar; what ended is not run again."""
    with running(len(jobs)) as tell:
        return dict(zip([job.name for job in jobs], kept_rows(jobs, folder, Limits(processors()), tell=tell), strict=True))


def typed(kind: str, question: Sequence[str]) -> list[str]:
    """The words of the runs but for the part."""
    keys = {word.partition("=")[0] for word in question}
    more = [] if "task" in keys else ["task=localise" if kind == "localiser" else "task=survey"]
    if kind == "localiser" and not keys & {"start", "restart_every_m", "kidnap_every_m"}:
        more.append(f"restart_every_m={recordings.RESTART_M:g}")
    return [*more, *question]


def _row(kind: str, rows: Mapping[str, Any], job: Job, mine: Job | None, folder: Path) -> dict[str, Any]:
    """The row of a run with what the card adds. mine: the job of the part of the card, None for itself."""
    row = dict(rows[job.name])
    return row if row["status"] != "ok" else row | recordings.of_card(kind, folder / job.name,
                                                                     None if mine is None else folder / mine.name)


def jobs_of(kind: str, name: str, own: Sequence[str],
            question: Sequence[str]) -> tuple[dict[str, Sequence[Job]], dict[str, str]]:
    """Part -> its runs, one for each recording; first the one that is judged, then those of ours that can be asked. And why
    others of ours cannot be."""
    words = typed(kind, question)
    why_not: dict[str, str] = {}
    jobs: dict[str, Sequence[Job]] = {f"{kind}={name}": plan([*words, f"{kind}={name}", *own]).first}
    for other in (one for one in recordings.BESIDE[kind] if one != name and one in registry.names(kind)):
        try:
            jobs[f"{kind}={other}"] = plan([*words, f"{kind}={other}"]).first
        except (ConfigError, PluginError) as error:
            why_not[f"{kind}={other}"] = str(error)  # it needs what these recordings do not have
        if len(jobs) > recordings.MOST_BESIDE:
            break
    return jobs, why_not


def called(jobs: Sequence[Job]) -> list[str]:
    """A name for each run: its recording, with what else the words vary where that is not all."""
    paths = [Path(str(getattr(job.config.parts["source"].settings, "path", "recording"))).name for job in jobs]
    if len({*paths}) == len(paths):
        return paths
    varied: list[Mapping[str, Any]] = [job.varied for job in jobs]
    return [" ".join([path, *(f"{key}={value}" for key, value in one.items() if key != "source.path")])
            for path, one in zip(paths, varied, strict=True)]
