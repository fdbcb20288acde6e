"""A planned sweep is run: here, or on an engine; what became of it."""

from __future__ import annotations

import json
import os
import secrets
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from rhs.api.contracts import complete
from rhs.api.engine import Engine, EngineContext
from rhs.api.files import replacing
from rhs.base.errors import ConfigError, ContractError, EngineError, RhsError, told, where
from rhs.config.compose import Composer
from rhs.config.loose import carried
from rhs.runfolder.shards import words_key

from .chunks import Chunk
from .drive import Driver, check_engine
from .jobs import Job, Limits, Outcome, asked_for, run_jobs
from .keep import Keeper, refused
from .sweep import Done, Plan, Report, finished, job_of, status_of
from .worker import COMPILING

Tell = Callable[[str, Outcome], None]


def run_plan(plan: Plan, folder: Path, limits: Limits, *, tell: Tell) -> Report:
    """Run what is not finished and write jobs.json, also when interrupted (the exception then carries `report`).
    tell(status, outcome so far): after each job, and with the status "" when time has passed."""
    run = Run(plan, folder, limits, tell)
    try:
        try:
            run.begin()
            run.here() if plan.choice.here else run.away()
        finally:
            run.keeper.close()
    except BaseException as error:
        error.report = run.account()  # type: ignore[attr-defined]
        raise
    return run.account()


@dataclass
class Run:
    """One start of a sweep."""

    plan: Plan
    folder: Path
    limits: Limits
    tell: Tell
    outcome: Outcome = field(default_factory=Outcome)
    done: Done = field(default_factory=Done)
    before: int = 0
    repeated: int = 0

    def __post_init__(self) -> None:
        self.keeper = Keeper(self.folder, self.plan.choice.keep)
        self.repeated = self.plan.repeated
        self.limits = replace(self.limits, share=self.plan.choice.share, cache=self.plan.choice.cache)

    def begin(self) -> None:
        """What is finished already."""
        self.done = finished(self.folder)
        if self.plan.lazy:
            self.before = len(self.done.words & self.plan.words_keys) if self.done.words else 0
        else:
            self.before = sum(job.key in self.done.configs for job in self.plan.first)
            for job in self.plan.first if self.plan.sharded else ():
                self._adopt(job)
        for _ in range(self.before):
            self.tell("ok", self.outcome)

    def _adopt(self, job: Job) -> bool:
        """Whether a job ended well in a folder that no shard tells of, as a killed sweep leaves them; it is told of now."""
        left = job.key in self.done.configs and words_key(job.words) not in self.done.lines
        left = left and (self.folder / job.name / "row.json").is_file()
        if left:
            self.keeper.take_folder(job)
        return left

    def here(self) -> None:
        """Processes of this machine, forked for this process."""
        def ended(job: Job, status: str) -> None:
            if status != COMPILING and self.plan.sharded:
                self.keeper.take_folder(job)
            self.tell(status, self.outcome)

        jobs = self._composed() if self.plan.lazy else iter([j for j in self.plan.first if j.key not in self.done.configs])
        run_jobs(jobs, self.folder, self.limits, tell=ended, outcome=self.outcome,
                 preload=asked_for(self.plan.first))

    def _composed(self) -> Iterator[Job]:
        """The jobs of a large sweep, each composed when its turn comes."""
        composer, seen = Composer(self.plan.conf), set(self.done.lines.values())
        for index in self._todo():
            words = self.plan.combinations[index]
            try:
                job = job_of(composer.config(words), words, self.plan.swept)
            except ConfigError as error:
                self.keeper.take(refused(words, self.plan.swept, error).text())
                self.outcome.count(" ".join(word.text for word in words), "refused", str(error))
                self.tell("refused", self.outcome)
                continue
            if self._adopt(job):
                self.before += 1
                self.tell("ok", self.outcome)
                continue
            if job.key in seen:
                self.repeated += 1
                continue
            seen.add(job.key)
            yield job

    def _todo(self) -> Iterator[int]:
        """Numbers of the combinations that are not finished."""
        texts = self.plan.combinations.texts
        return (index for index in range(len(self.plan.combinations)) if words_key(texts(index)) not in self.done.words)

    def away(self) -> None:
        """Whatever executor the engine hands out."""
        token = f".here-{secrets.token_hex(8)}"
        engine = self._engine()
        driver = Driver(engine, self._chunk(token, engine.processes), self.keeper, self.outcome,
                        told=lambda status: self.tell(status, self.outcome), same_failures=self.limits.same_failures,
                        seen=set(self.done.lines.values()), total=len(self.plan) - self.before)
        (self.folder / token).touch()
        try:
            driver.run(self._words())
        except EngineError as error:
            raise EngineError(f"engine={self.plan.choice.engine}: {error}; what was finished is kept, go on by: "
                              f"python -m rhs --resume {self.folder}") from error
        finally:
            (self.folder / token).unlink(missing_ok=True)
            self.repeated += driver.repeated

    def _engine(self) -> Engine:
        context = EngineContext(self.limits.jobs, self.folder)
        try:
            return check_engine(complete("engine", self.plan.choice.settings.build(context)))
        except ContractError as error:
            raise ConfigError(f"engine={self.plan.choice.engine}: {error}") from error
        except (RhsError, KeyboardInterrupt):
            raise
        except BaseException as error:  # somebody's may even exit
            raise EngineError(f"engine={self.plan.choice.engine}: {told(error)[:300]}{where(error)}") from error

    def _words(self) -> Iterator[list[str]]:
        """The words of each job that is not finished."""
        if self.plan.lazy:
            return (list(self.plan.combinations.texts(index)) for index in self._todo())
        return (list(job.words) for job in self.plan.first if job.key not in self.done.configs)

    def _chunk(self, token: str, jobs: int) -> Chunk:
        """What all chunks have in common."""
        names = {(kind, one.name) for job in self.plan.first
                 for kind, one in {"task": job.config.task, **job.config.parts}.items()}
        return Chunk([], list(self.plan.swept), asdict(replace(self.limits, same_failures=0, jobs=jobs)),
                     self.plan.choice.keep, str(self.folder.absolute()), token, os.getcwd(),
                     [str(Path(p).absolute()) for p in self.plan.conf], carried(names))

    def account(self) -> Report:
        """What became of every job, as the rows say; a full disk costs jobs.json, not the account."""
        counts, reasons = Counter(self.outcome.counts), Counter(self.outcome.reasons)
        statuses: dict[str, object]
        if self.plan.lazy:
            counts["ok"] += self.before
            statuses = dict(counts)
        else:
            known = {job.name: "ok" for job in self.plan.first if job.key in self.done.configs}
            known |= self.outcome.status | status_of(self.plan, self.folder)
            statuses = {job.name: known.get(job.name, "skipped") for job in self.plan.first}
            counts = Counter(map(str, statuses.values()))
        asked = {job.key for job in self.plan.first}
        reasons.update(short for config, short in self.done.configs.items() if short and (self.plan.lazy or config in asked))
        missing = len(self.plan.combinations) - self.repeated - sum(counts.values())
        counts["skipped"] += max(0, missing)
        try:
            with replacing(self.folder / "jobs.json") as file:
                file.write(json.dumps(statuses, indent=1) + "\n")
        except RhsError as error:
            reasons[str(error)] += 1
        return Report(counts, reasons, self.before, self.outcome.stopped, self.repeated, self.outcome.kept)
