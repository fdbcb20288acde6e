"""A sweep from words to table: plan its jobs, run what is not finished, say what became of them.

sweep.json remembers the words, so that `--resume FOLDER` needs nothing else. A job is known by the hash of its
configuration: more seeds may be added to a sweep later, what is finished stays; a job that the new words no longer
contain means that something else changed, and is refused.

Up to MOST_PLANNED jobs are all composed and checked before the first starts. Of a larger sweep the edges are
(`Combinations.edges`) and some between; each job is then composed when its turn comes, where it runs, and is known by
its words.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rhs.api.files import replacing
from rhs.base.errors import ConfigError, RhsError
from rhs.config import registry
from rhs.config.compose import Composer, RunConfig, config_hash, to_plain
from rhs.config.loose import loose_names
from rhs.config.overrides import Combinations, Word, parse, sweep_words, swept_keys
from rhs.runfolder.folders import set_aside
from rhs.runfolder.row import read_row
from rhs.runfolder.shards import from_rows, key_of, lines_of, shards, words_key

from .choice import Choice, choose, split
from .ending import shortfall
from .jobs import Job

MOST_JOBS = 100_000
MOST_PLANNED = 300  # jobs composed before the first starts
MOST_EDGES = 40  # values of one axis tried before
DRAWN = 20  # jobs composed before the first of a larger sweep starts, beside its edges; they lie
GOLDEN = 0.6180339887498949  # this share of the sweep apart, which leaves no large part of it out


@dataclass(frozen=True)
class Plan:
    """A sweep that may run. first: its jobs, each configuration once, where all were composed beforehand, else its first
    and some others; repeated: words that gave a configuration which was there already."""

    words: tuple[str, ...]
    conf: tuple[Path, ...]
    combinations: Combinations
    swept: tuple[str, ...]
    first: tuple[Job, ...]
    output: str
    repeated: int
    choice: Choice

    @property
    def lazy(self) -> bool:
        """Whether jobs are composed when their turn comes."""
        return len(self.combinations) > MOST_PLANNED

    @property
    def sharded(self) -> bool:
        """Whether rows are written into shards."""
        return self.lazy or self.choice.keep != "all" or not self.choice.here

    def __len__(self) -> int:
        return len(self.combinations) - self.repeated

    @cached_property
    def jobs(self) -> tuple[Job, ...]:
        """Every job, each configuration once; composed now if they were not."""
        return tuple(_once(self.combinations, Composer(self.conf), self.swept)) if self.lazy else self.first

    @cached_property
    def words_keys(self) -> frozenset[str]:
        """The keys of all words of this sweep."""
        return frozenset(words_key(self.combinations.texts(i)) for i in range(len(self.combinations)))


def plan(words: Sequence[str], conf: tuple[Path, ...] = ()) -> Plan:
    """Read the words, compose and check what is checked before the first job starts. Raises ConfigError in one line."""
    chosen, rest = split(words)
    overrides = parse(_with_experiment(rest, conf))
    swept = swept_keys(overrides)
    if "output" in swept:
        raise ConfigError("output: a sweep has one folder; its runs get folders inside it")
    combinations = sweep_words(overrides, most=MOST_JOBS)
    composer, count = Composer(conf), len(combinations)
    output = composer.config(combinations[0]).output
    if count > MOST_PLANNED:
        drawn = [int(count * (GOLDEN * i % 1.0)) for i in range(1, DRAWN)]
        first = [job_of(composer.config(combinations[i]), combinations[i], swept)
                 for i in [*combinations.edges(MOST_EDGES), *drawn]]
    else:
        first = _once(combinations, composer, swept)
    repeated = count - len(first) if count <= MOST_PLANNED else 0
    return Plan(tuple(words), conf, combinations, tuple(swept), tuple(first), output, repeated, choose(chosen, count))


def _once(combinations: Combinations, composer: Composer, swept: Sequence[str]) -> list[Job]:
    """The jobs, each configuration once."""
    jobs: dict[str, Job] = {}
    for combination in combinations:
        job = job_of(composer.config(combination), combination, swept)
        jobs.setdefault(job.key, job)
    return list(jobs.values())


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
    ahead = "off" if config.ahead == "auto" else config.ahead
    config = replace(config, output="", overwrite=False, recording=recording, pictures=pictures, live="", ahead=ahead)
    last = {word.key: word.text for word in combination if word.key in swept}  # of one typed twice, that which counts
    told = ",".join(last.values())
    readable = re.sub(r"[^A-Za-z0-9._=,+-]", "-", told).strip(".-")[:60]
    name = f"{readable}_{config_hash(config)}" if readable else config_hash(config)
    varied = {word.key: word.value if isinstance(word.value, bool | int | float | str | None) else str(word.value)
              for word in combination if word.key in swept and not word.is_group and word.key not in ("world", "seed")}
    return Job(name, config, tuple(word.text for word in combination), varied)


def remember(plan: Plan, folder: Path) -> None:
    """Write sweep.json. Jobs of another configuration (--force) are moved into a folder beside the sweep."""
    known = {job.key for job in plan.first}
    others = [path.parent for path in sorted(folder.glob("*/row.json")) if _key(path.parent.name) not in known]
    set_aside(folder, ([] if plan.lazy else others) + [path.parent for path in _shards_of_others(plan, folder)[:1]])
    with replacing(folder / "sweep.json") as file:
        file.write(json.dumps({"rhs": version("rhs"), "words": plan.words, "conf": [str(path) for path in plan.conf],
                               "plugins": loose_names(), "sources": _sources(plan), "count": len(plan.combinations),
                               "jobs": {} if plan.lazy else {job.name: job.words for job in plan.first},
                               "example_words": plan.first[0].words, "example": to_plain(plan.first[0].config)},
                              indent=1) + "\n")


def _shards_of_others(plan: Plan, folder: Path) -> list[Path]:
    """Shards that hold rows of words which this sweep does not have."""
    return [path for path in shards(folder) if not {key_of(text) for text in lines_of(path, [])} <= plan.words_keys]


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
    _check_sources(_sources(plan), before.get("sources", []), folder)
    if _same_jobs(plan, folder, before):
        return
    differing = _differences(before.get("example", {}), to_plain(plan.first[0].config))
    those = f"of another configuration: {', '.join(differing[:3])}" if differing else "that these words do not ask for"
    raise ConfigError(f"{folder} holds jobs {those}; take another folder or type --force")


def _sources(plan: Plan) -> list[str]:
    """`kind=name from ...` of the parts and metrics that are not ours, with the hash of their code."""
    found = {text for job in plan.first for text in registry.sources(job.config.task.name, {
        kind: chosen.name for kind, chosen in job.config.parts.items()})}
    return sorted(found | {text for text in loose_names() if text.startswith("metric=")})


def _check_sources(now: Sequence[str], before: Sequence[str], folder: Path) -> None:
    """Refuse to mix rows of one code with those of another."""
    have = {text.partition(" from ")[0]: text for text in now}
    for text in before:
        name, _, was = text.partition(" from ")
        if name.startswith("metric=") and name not in have:
            raise ConfigError(f"the sweep has {text}: add --plugin FILE")
        if have.get(name, text) != text:
            raise ConfigError(f"{name} was {was}, is {have[name].partition(' from ')[2]} now; take another folder, or type "
                              f"--force to keep the old rows of {folder}")


def _same_jobs(plan: Plan, folder: Path, before: dict[str, Any]) -> bool:
    """Whether all jobs of before are among those of now, and their words still mean what they meant."""
    if not plan.lazy and before["jobs"]:
        known = {job.key for job in plan.first}
        return all(_key(name) in known for name in before["jobs"])
    if any(words_key(words) not in plan.words_keys for words in before["jobs"].values()) or _shards_of_others(plan, folder):
        return False
    words = plan.combinations.words_of([word for word in before.get("example_words", []) if not word.startswith("output=")])
    now = job_of(Composer(plan.conf).config(words), words, ()).config
    return not words or _differences(before.get("example", {}), to_plain(now)) == []


def _key(name: str) -> str:
    """The hash of the configuration in the name of a job's folder."""
    return name.rpartition("_")[2]


def _differences(old: Any, new: Any, key: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        return [text for name in {**old, **new} for text in
                _differences(old.get(name), new.get(name), f"{key}.{name}" if key else str(name))]
    return [] if old == new else [f"{key} was {old}, is {new}"]


@dataclass(frozen=True)
class Done:
    """Jobs that ended well before we came. configs: hash of their configurations -> what was not achieved, empty: nothing.
    words: keys of their words, where known. lines: of those in shards, key of the words -> hash of the configuration."""

    configs: Mapping[str, str] = field(default_factory=dict)
    words: frozenset[str] = frozenset()
    lines: Mapping[str, str] = field(default_factory=dict)


def finished(folder: Path) -> Done:
    """What ended well, as folders and shards say."""
    configs, words, named = {}, set(), _named(folder)
    for path in sorted(folder.glob("*/row.json")):
        try:
            if (row := read_row(path)).get("status") == "ok":
                configs[_key(path.parent.name)] = shortfall(row)
                words |= {named[path.parent.name]} if path.parent.name in named else set()
        except RhsError:
            continue
    ended = from_rows(shards(folder), [], lambda line: (str(line.row.get("config_hash")), shortfall(line.row))
                      if line.row["status"] == "ok" else ("", ""))
    lines = {key: config for key, (config, _) in ended.items() if config}
    return Done(configs | dict(ended[key] for key in lines), frozenset(words | {*lines}), lines)


def _named(folder: Path) -> dict[str, str]:
    """Name of a job -> the key of its words, of a sweep whose jobs are listed."""
    try:
        return {name: words_key(words) for name, words in recall(folder)["jobs"].items()}
    except ConfigError:
        return {}


def status_of(plan: Plan, folder: Path) -> dict[str, str]:
    """What the rows say became of each job of a sweep that was planned whole; jobs without a row are missing."""
    lines = dict(from_rows(shards(folder), [], lambda line: (line.run, str(line.row["status"]))).values())
    found: dict[str, str] = {}
    for job in plan.first:
        try:
            found[job.name] = str(read_row(folder / job.name / "row.json")["status"])
        except (RhsError, KeyError):
            if job.name in lines:
                found[job.name] = lines[job.name]
    return found


@dataclass(frozen=True)
class Report:
    """counts: jobs by what became of them. before: jobs that were finished when we came. repeated: words that gave a
    configuration which was there already. kept: surveys that earlier sweeps had led."""

    counts: Counter
    reasons: Counter
    before: int
    stopped: str
    repeated: int = 0
    kept: int = 0

    @property
    def complete(self) -> bool:
        return set(+self.counts) <= {"ok"} and not self.reasons

    @property
    def failed(self) -> int:
        """Jobs that did not end well, or not as was asked."""
        return sum(self.counts.values()) - self.counts["ok"] or sum(self.reasons.values())

    def lines(self) -> list[str]:
        """The accounts in words, most frequent reasons of failure first."""
        counts = +self.counts
        words = ", ".join(f"{counts[name]} {name}" for name in sorted(counts, key=lambda n: (n != "ok", n)))
        lines = [f"{sum(counts.values())} jobs: {words}" + (f" ({self.before} finished before)" if self.before else "")]
        lines += [f"  {count} x {reason[:160]}" for reason, count in self.reasons.most_common(5)]
        if self.kept:
            lines.append(f"{self.kept} of their surveys had been led by earlier sweeps (cache=false leads them anew)")
        return [*lines, self.stopped] if self.stopped else lines
