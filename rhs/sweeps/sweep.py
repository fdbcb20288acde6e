"""A sweep from words to table: plan its jobs, run what is not finished, say what became of them.

sweep.json remembers the words, so that `--resume FOLDER` needs nothing else. A job is known by the hash of its
configuration: more seeds may be added to a sweep later, what is finished stays; a job that the new words no longer
contain means that something else changed, and is refused.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rhs.api.files import replacing
from rhs.base.errors import ConfigError, RhsError
from rhs.config.compose import Composer, RunConfig, config_hash, to_plain
from rhs.config.loose import loose_names
from rhs.config.overrides import Word, parse, sweep_words, swept_keys
from rhs.runfolder.folders import set_aside
from rhs.runfolder.row import read_row

from .jobs import Job, Limits, Outcome, run_jobs

MOST_JOBS = 100_000


@dataclass(frozen=True)
class Plan:
    """The jobs of a sweep in order, each configuration once, and how many words gave one that was there already."""

    words: tuple[str, ...]
    conf: tuple[Path, ...]
    jobs: tuple[Job, ...]
    output: str
    repeated: int


def plan(words: Sequence[str], conf: tuple[Path, ...] = ()) -> Plan:
    """Compose and check every job before the first one starts. Raises ConfigError in one line."""
    overrides = parse(_with_experiment(words, conf))
    swept = swept_keys(overrides)
    if "output" in swept:
        raise ConfigError("output: a sweep has one folder; its runs get folders inside it")
    combinations = sweep_words(overrides, most=MOST_JOBS)
    composer, output = Composer(conf), ""
    jobs: dict[str, Job] = {}
    for combination in combinations:
        config = composer.config(combination)
        output = config.output
        job = job_of(config, combination, swept)
        jobs.setdefault(config_hash(config), job)
    return Plan(tuple(words), conf, tuple(jobs.values()), output, len(combinations) - len(jobs))


def _with_experiment(words: Sequence[str], conf: tuple[Path, ...]) -> list[str]:
    """The words, and those the experiment sweeps over unless they were typed."""
    from rhs.config.hydra_glue import experiment_sweep

    typed = {word.partition("=")[0]: word.partition("=")[2] for word in words}
    own = experiment_sweep(typed["experiment"], conf) if typed.get("experiment") else []
    return [*(word for word in own if word.partition("=")[0] not in typed), *words]


def job_of(config: RunConfig, combination: Sequence[Word], swept: Sequence[str]) -> Job:
    """A job, its folder named after the values of the keys that are swept; big files are left out unless asked for."""
    recording = "light" if config.recording == "auto" else config.recording
    pictures = "off" if config.pictures == "auto" else config.pictures
    config = replace(config, output="", overwrite=False, recording=recording, pictures=pictures, live="")
    told = ",".join(word.text for word in combination if word.key in swept)
    readable = re.sub(r"[^A-Za-z0-9._=,+-]", "-", told).strip(".-")[:60]
    name = f"{readable}_{config_hash(config)}" if readable else config_hash(config)
    return Job(name, config, tuple(word.text for word in combination))


def remember(plan: Plan, folder: Path) -> None:
    """Write sweep.json. Jobs of another configuration (--force) are moved into a folder beside the sweep."""
    known = {job.key for job in plan.jobs}
    set_aside(folder, [path.parent for path in sorted(folder.glob("*/row.json")) if _key(path.parent.name) not in known])
    with replacing(folder / "sweep.json") as file:
        file.write(json.dumps({"rhs": version("rhs"), "words": plan.words, "conf": [str(path) for path in plan.conf],
                               "plugins": loose_names(), "jobs": {job.name: job.words for job in plan.jobs},
                               "example": to_plain(plan.jobs[0].config)}, indent=1) + "\n")


def recall(folder: Path) -> dict[str, Any]:
    """What sweep.json says. Raises ConfigError when it is not there or not readable."""
    path = folder / "sweep.json"
    try:
        content = json.loads(path.read_text("utf-8"))
        words, conf, jobs = content["words"], content["conf"], content["jobs"]
    except FileNotFoundError:
        raise ConfigError(f"{folder} holds no sweep (no sweep.json); start one by -m output={folder}") from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} cannot be read as a sweep: {error}") from error
    if not (isinstance(words, list) and isinstance(conf, list) and isinstance(jobs, dict)):
        raise ConfigError(f"{path} was not written by this program; take another folder")
    return content


def check_same(plan: Plan, folder: Path, before: dict[str, Any]) -> None:
    """Refuse to go on with a sweep whose version or configuration is another, naming what differs."""
    if before.get("rhs") != version("rhs"):
        raise ConfigError(f"{folder} was made by rhs {before.get('rhs')}, this is {version('rhs')}; take another folder "
                          f"or type --force")
    known = {job.key for job in plan.jobs}
    if all(_key(name) in known for name in before["jobs"]):
        return
    differing = _differences(before.get("example", {}), to_plain(plan.jobs[0].config))
    raise ConfigError(f"{folder} holds jobs of another configuration: {', '.join(differing[:3]) or 'other values'}; "
                      f"take another folder or type --force")


def _key(name: str) -> str:
    """The hash of the configuration in the name of a job's folder."""
    return name.rpartition("_")[2]


def _differences(old: Any, new: Any, key: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        return [text for name in {**old, **new} for text in
                _differences(old.get(name), new.get(name), f"{key}.{name}" if key else str(name))]
    return [] if old == new else [f"{key} was {old}, is {new}"]


def finished(folder: Path) -> dict[str, Path]:
    """Config hash -> folder of every job that ended well."""
    done = {}
    for path in sorted(folder.glob("*/row.json")):
        try:
            if read_row(path).get("status") == "ok":
                done[_key(path.parent.name)] = path.parent
        except RhsError:
            continue
    return done


def run_plan(plan: Plan, folder: Path, limits: Limits, *, tell: Callable[[Job, str], None]) -> Report:
    """Run what is not finished and write jobs.json, also when interrupted (the exception then carries `report`)."""
    done = finished(folder)
    todo = [job for job in plan.jobs if job.key not in done]
    for job in plan.jobs:
        if job.key in done:
            tell(job, "ok")
    try:
        outcome = run_jobs(todo, folder, limits, tell=tell)
    except BaseException as error:
        outcome = getattr(error, "outcome", Outcome())
        error.report = _account(plan, folder, outcome, done)  # type: ignore[attr-defined]
        raise
    return _account(plan, folder, outcome, done)


@dataclass(frozen=True)
class Report:
    """status: job -> what became of it, for every job planned. before: jobs that were finished when we came."""

    status: dict[str, str]
    reasons: Counter
    before: int
    stopped: str

    @property
    def complete(self) -> bool:
        return set(self.status.values()) == {"ok"} and not self.reasons

    def lines(self) -> list[str]:
        """The accounts in words, most frequent reasons of failure first."""
        counts = Counter(self.status.values())
        words = ", ".join(f"{counts[name]} {name}" for name in sorted(counts, key=lambda n: (n != "ok", n)))
        told = [f"{len(self.status)} jobs: {words}" + (f" ({self.before} finished before)" if self.before else "")]
        told += [f"  {count} x {reason[:160]}" for reason, count in self.reasons.most_common(5)]
        return [*told, self.stopped] if self.stopped else told


def _account(plan: Plan, folder: Path, outcome: Outcome, done: dict[str, Path]) -> Report:
    """What became of every job, as the rows say; a full disk costs jobs.json, not the account."""
    status = {}
    for job in plan.jobs:
        try:
            status[job.name] = str(read_row(done.get(job.key, folder / job.name) / "row.json")["status"])
        except (RhsError, KeyError):
            status[job.name] = outcome.status.get(job.name, "skipped")
    try:
        with replacing(folder / "jobs.json") as file:
            file.write(json.dumps(status, indent=1) + "\n")
    except RhsError as error:
        outcome.reasons[str(error)] += 1
    return Report(status, outcome.reasons, len(done.keys() & {job.key for job in plan.jobs}), outcome.stopped)
