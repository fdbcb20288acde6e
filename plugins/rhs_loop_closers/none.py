"""Loop closer `none`: the survey stays as the odometry believed it, and as unsure as its motions say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rhs.api.contracts import Context, LoopCloser, PartSettings
from rhs.api.records import Closure, View


@dataclass
class NoClosing(PartSettings):
    """Leaves the survey as it is."""

    def build(self, context: Context) -> LoopCloser:
        return Unclosed()


class Unclosed:
    """Returns the poses it was given."""

    def close(self, views: Sequence[View]) -> Closure:
        from rhs.estimation.views.loops import covariances_of, poses_of

        return Closure(poses_of(views), covariances=covariances_of(views))
