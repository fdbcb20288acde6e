"""A job of a sweep, the limits it runs within, and what became of all of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rhs.base.errors import ConfigError
from rhs.base.system import CAN_FORK, total_memory_mb
from rhs.config.compose import RunConfig

MEMORY_MB = 4096.0  # of one job, where the machine has as much for each
MOST_NAMED = 2_000  # jobs and reasons remembered by name


@dataclass(frozen=True)
class Job:
    """One run of a sweep: its folder's name (readable values and config hash), its configuration, its words."""

    name: str
    config: RunConfig
    words: tuple[str, ...]
    varied: Mapping[str, Any] = field(default_factory=dict)  # settings that the sweep varies, as columns of the table

    @property
    def key(self) -> str:
        """The hash of the configuration, by which a job is known again."""
        return self.name.rpartition("_")[2]


@dataclass(frozen=True)
class Limits:
    """jobs: processes at a time. timeout_s: per job, 0 for none. same_failures: stop after so many alike, 0 never.
    memory_mb: of a job and what it starts, 0 for 4096 or its share of the machine. retries: of a job that was killed.
    share: jobs that begin with the same survey lead it once (its time counts for the first of them).
    cache: surveys are taken from those that earlier sweeps kept (rhs.sweeps.survey_cache). Raises ConfigError
    where no process can fork: jobs do."""

    jobs: int = 1
    timeout_s: float = 3600.0
    same_failures: int = 0
    memory_mb: float = 0.0
    retries: int = 1
    share: bool = True
    cache: bool = False

    def __post_init__(self) -> None:
        if not CAN_FORK:
            raise ConfigError("the jobs of a sweep are processes that fork, which this system cannot do; run them one by "
                              "one, or under Linux (on Windows: in WSL)")

    @property
    def memory_bytes(self) -> float:
        return 2**20 * (self.memory_mb or min(MEMORY_MB, 0.9 * total_memory_mb() / self.jobs))


@dataclass
class Outcome:
    """What became of the jobs of a sweep; jobs that were never started are missing."""

    counts: Counter = field(default_factory=Counter)  # jobs by status
    status: dict[str, str] = field(default_factory=dict)  # by name, of the first MOST_NAMED
    reasons: Counter = field(default_factory=Counter)
    stopped: str = ""  # why not every job was started
    kept: int = 0  # surveys that earlier sweeps had led
    workers: int | None = None  # alive, where somebody knows

    def count(self, name: str, status: str, reason: str) -> None:
        """Take in one job that is over."""
        self.counts[status] += 1
        if len(self.status) < MOST_NAMED:
            self.status[name] = status
        text = f"ok, but {reason}" if status == "ok" else f"{status}: {reason}" if reason else status
        if status != "ok" or reason:  # it ended, without what was asked of it
            self.reasons[text if text in self.reasons or len(self.reasons) < MOST_NAMED else "other reasons"] += 1


def alike(outcome: Outcome, same_failures: int) -> str:
    """Why the sweep is to stop: so many jobs ended alike; empty while they did not."""
    if same_failures and outcome.reasons:
        reason, count = outcome.reasons.most_common(1)[0]
        if count >= same_failures:
            return f"stopped after {count} jobs ended alike: {reason}"
    return ""
