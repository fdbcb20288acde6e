"""A survey that is led once for several runs: what a run needs to go on from it as if it had led it itself."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rhs.api.contracts import Odometry
from rhs.api.records import Step
from rhs.api.task import Parts
from rhs.estimation.survey import Survey as Surveyed

if TYPE_CHECKING:
    from rhs.api.floorplan import World

    from .eyes import Looked
    from .observers import RunLog
    from .run import RunContext

LATER = ("planner", "localiser", "replan")  # parts that a survey does not ask


@dataclass(frozen=True)
class SharedSurvey:
    """parts: of the survey, as they were built. odometry: behind its gate. steps: without images, as a light recording
    wants them; none where nothing is recorded. files: by name, that leading it left, and rows: of steps.csv. counts,
    began_s, stamp_s: of the log. took_s: of the wall's clock. drawn: whose global generators it used. said: printed.
    kept: whether an earlier process led it."""

    parts: Parts
    odometry: Odometry
    survey: Surveyed
    steps: tuple[Step, ...]
    files: Mapping[str, bytes]
    rows: str
    counts: Mapping[str, int]
    began_s: float | None
    stamp_s: float
    took_s: float
    drawn: frozenset[str] = frozenset()
    said: str = ""
    kept: bool = False

    def hand_over(self, log: RunLog) -> Surveyed:
        """Leave in the files of a run what leading this survey would have left there."""
        log.table.add_rows(self.rows)
        for step in self.steps:
            log.recorder.step(step)
        log.recorder.map(self.survey.grid, float(self.survey.views[-1].stamp_s))
        log.counts.update(self.counts)
        log.stamp_s, log.began_s = self.stamp_s, self.began_s
        for name, content in self.files.items():
            path = log.folder / name
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        return self.survey


@dataclass(frozen=True)
class DrawnViews:
    """The views of a survey whose way depends on no estimate, for runs that differ in what they make of them. parts: source
    and sensor, which stand at its end. seen: each is let go where it is taken from. building: as it was read.
    took_s: of the wall's clock."""

    parts: Parts
    seen: list[Looked]
    building: World | None
    took_s: float


def led_for_others(leading: Generator[Step, None, Surveyed], parts: Parts, context: RunContext, log: RunLog, *,
                   ungated: Odometry, recorded: bool) -> Generator[Step, None, SharedSurvey]:
    """The steps of a survey that is being led by these parts, as they come, and what it leaves for others to go on from.
    ungated: their odometry without its gate. recorded: whether the recordings of others want its steps."""
    before, bare = set(log.folder.rglob("*")), list[Step]()
    while True:
        try:
            step = next(leading)
        except StopIteration as end:
            survey: Surveyed = end.value
            break
        if recorded:
            bare.append(replace(step, observation=replace(step.observation, image=None, depth=None, extras={})))
        yield step
    files = {str(path.relative_to(log.folder)): path.read_bytes() for path in sorted(log.folder.rglob("*"))
             if path not in before and path.is_file() and ".tmp-" not in path.name}
    built = replace(parts, odometry=ungated, **dict.fromkeys(LATER))  # type: ignore[arg-type]
    return SharedSurvey(built, parts.odometry, survey, tuple(bare), files, log.table.partial.read_text("utf-8"),
                        dict(log.counts), log.began_s, log.stamp_s, time.perf_counter() - context.began_s,
                        frozenset(context.drawn()))
