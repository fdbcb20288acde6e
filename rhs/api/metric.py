"""What a metric is: one column of the row, computed from the files of a run folder alone.

An entry point in the group `rhs.metric` names a tuple of Metric. One list feeds the row, what stands there when nothing
is known (NaN, or an empty word), `python -m rhs help columns` and the data dictionary in the documents.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

from .grid import OccupancyGrid
from .trajectory import Trajectory

Result = TypeVar("Result")
LOOP = ("patrol", "survey", "explore", "blame")  # the tasks that go through the loop of views


class RunFiles(Protocol):
    """A run folder as a metric sees it; each file is read once, when asked for."""

    folder: Path

    @property
    def steps(self) -> Sequence[Mapping[str, str]]:
        """The lines of steps.csv as text; unknown is empty."""

    def trajectory(self, name: str) -> Trajectory | None:
        """`estimate`, `corrected`, `truth_survey`, `patrol`, `truth_patrol`, `localised` or `truth_localised`;
        None where there is none."""

    def grid(self, name: str) -> OccupancyGrid | None:
        """`map`, `map_patrol`, `true_map` or `true_map_patrol`; None where there is none."""

    def json(self, name: str) -> Any:
        """The content of NAME.json (`facts`, `missions`, `plans`, `closure`, `plan`), or None."""

    def once(self, function: Callable[[Any], Result]) -> Result:
        """`function(self)`, computed once for all the metrics that ask for it."""


@dataclass(frozen=True)
class Metric:
    """One column. name: ends in its unit (`_m`, `_rad`, `_share`, `_pct`, `_ms`, ...); a name that ends in `_ms` depends on
    the machine. unit: as people write it, empty for counts and words. meaning: one sentence. source: the paper or file it
    follows. function: of the run folder; it returns NaN (or an empty word) where nobody knows. tasks: whose rows have it;
    empty: every task's. word: the value is text. count: it is a whole number. more_is_better: of two runs the one with more
    of it did better (`gate`); of any other column the one with less."""

    name: str
    unit: str
    meaning: str
    source: str
    function: Callable[[RunFiles], float | int | str]
    tasks: tuple[str, ...] = LOOP
    word: bool = False
    count: bool = False
    more_is_better: bool = False

    @property
    def unknown(self) -> float | str:
        """What stands in the row when nothing is known."""
        return "" if self.word else float("nan")


def columns_of(compute: Callable[[RunFiles], Mapping[str, float | int | str]],
               *columns: tuple[str, str, str, str], tasks: tuple[str, ...] = LOOP,
               words: tuple[str, ...] = (), counts: tuple[str, ...] = (), more_is_better: tuple[str, ...] = (),
               ) -> tuple[Metric, ...]:
    """Metrics that one function computes together. columns: (name, unit, meaning, source), one for each. words, counts:
    those whose values are texts or whole numbers; more_is_better: those that are losses where they fall.
    Raises ValueError for such a name that is no column's."""
    unknown = {*words, *counts, *more_is_better} - {name for name, *_ in columns}
    if unknown:
        raise ValueError(f"columns_of: {', '.join(sorted(unknown))}: no column has that name")

    def one(name: str) -> Callable[[RunFiles], float | int | str]:
        return lambda run: run.once(compute)[name]

    return tuple(Metric(name, unit, meaning, source, one(name), tasks, name in words, name in counts,
                        name in more_is_better)
                 for name, unit, meaning, source in columns)
