"""How far a sweep is: a bar on a terminal, elsewhere a line every minute."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO

from rhs.sweeps.jobs import Outcome
from rhs.sweeps.worker import COMPILING

from .one_run import COMPILES

EVERY_S = 60.0


class Progress:
    """Told of every job; `total` is how many there are, `unit` what one is called, `found()` what is known so far."""

    def __init__(self, total: int, *, unit: str = "job", found: Callable[[], str] = str, out: TextIO | None = None,
                 every_s: float = EVERY_S) -> None:
        from tqdm import tqdm

        self.total, self.unit, self.found, self.out, self.every_s = total, unit, found, out or sys.stderr, every_s
        self.done = self.came = 0  # all, and those since we began
        self.began = self.said = time.monotonic()
        self.bar = tqdm(total=total, unit=unit, disable=None, dynamic_ncols=True, file=self.out, smoothing=0.05)

    def tell(self, status: str, outcome: Outcome, *, known: bool = False) -> None:
        """One more job, or with the status "" only more time. known: it ended before we began and
        says nothing of the rate."""
        if status == COMPILING:
            self.bar.write(COMPILES, file=self.out)
            return
        if status:
            self.done += 1
            self.came += not known and sum(outcome.counts.values()) > 0
            self.bar.set_postfix_str(self._summary(outcome), refresh=False)
            self.bar.update()
        now = time.monotonic()
        if self.bar.disable and now - self.said >= self.every_s:
            self.said = now
            print(f"rhs: {self.line(outcome, now)}", file=self.out, flush=True)

    def line(self, outcome: Outcome, now: float) -> str:
        """Jobs done, rate, time left, failures by reason, workers alive."""
        rate = self.came / max(now - self.began, 1e-9)
        left = f"{_time((self.total - self.done) / rate)} left" if rate > 0 else f"no {self.unit} back yet"
        return f"{self.done} of {self.total} {self.unit}s, {rate:.3g} a second, {left}; {self._summary(outcome)}"

    def _summary(self, outcome: Outcome) -> str:
        counts = [f"{count} {status}" for status, count in sorted(outcome.counts.items(), key=lambda one: one[0] != "ok")]
        reasons = [f"{count} x {reason[:50]}" for reason, count in outcome.reasons.most_common(2)]
        workers = [] if outcome.workers is None else [f"{outcome.workers} workers"]
        found = [text] if (text := self.found()) else []
        return ", ".join([*counts, *workers, *found]) + (f" ({'; '.join(reasons)})" if reasons else "")

    def close(self) -> None:
        """The bar ends."""
        self.bar.close()


def _time(seconds: float) -> str:
    """A duration to be read at a glance."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


@contextmanager
def running(total: int, *, unit: str = "job", found: Callable[[], str] = str) -> Iterator[Callable[[object, str], None]]:
    """A bar over so many jobs; yields what is told of each: (the job, how it ended); of one that ended before, its name."""
    progress, outcome = Progress(total, unit=unit, found=found), Outcome()

    def tell(job: object, status: str) -> None:
        if status != COMPILING:
            outcome.count(str(getattr(job, "name", job)), status, "")
        progress.tell(status, outcome, known=isinstance(job, str))

    try:
        yield tell
    finally:
        progress.close()
