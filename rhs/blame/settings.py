"""The task `blame`: a patrol, and the same patrol again with links of the chain replaced by the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import ConfigError, check_choice, within
from rhs.metrics.blame import LINKS
from rhs.patrol.tasks import Patrol

if TYPE_CHECKING:
    from rhs.patrol.run import RunContext

    from .job import BlameJob

MOST_EXACT = 5


@dataclass
class Blame(Patrol):
    """A patrol, and why it was no better: each link of the chain replaced by the truth in turn, the loss shared out by
    Shapley's rule (Shapley 1953). Its own figures are those of the patrol with nothing replaced."""

    links: list[str] = field(default_factory=lambda: ["odometry", "closing", "map", "localise"])
    """links that are judged: sense, odometry, closing, map, localise, plan, drive. Up to five: as many combinations of them
    are tried as the shares need; more: combinations along random orders"""
    exact: bool = False
    """try every combination of up to five links. Else a combination is left out where those with less and with more truth
    lost the same, and when the shares are known within half of what is worth a verdict (a quarter of a place, 5 cm of
    belief or survey, 0.5 m of way): one truth more is taken to make nothing worse"""
    orders: int = within(12, 2, 10_000)
    """random orders of more than five links (Castro, Gomez and Tejada 2009); more orders, narrower intervals"""
    processes: int = within(0, 0, 1024)
    """processes at a time; 0: one per core"""

    needs: ClassVar[frozenset[str]] = frozenset({"driving"})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mission.survey == "explore":
            raise ConfigError("mission.survey=explore: task=blame takes one survey for all its patrols; "
                              "type mission.survey=route")
        for link in self.links:
            check_choice("", "links", link, LINKS)
        if not self.links or len(set(self.links)) < len(self.links):
            raise ConfigError(f"links={self.links}: expected one or more different words of {', '.join(LINKS)}")

    def build(self, context: RunContext) -> BlameJob:  # type: ignore[override]
        from rhs.patrol.job import since_survey

        from .job import BlameJob

        world = context.floor_plan()
        if world is None:
            raise ConfigError("task=blame needs a world that can be driven in again; a recording cannot")
        return BlameJob(self, context, since_survey(world, self, context.seed))
