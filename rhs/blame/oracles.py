"""The truth in the place of a part. Made by task=blame alone, for counterfactual runs; no ordinary run can choose one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rhs.api.contracts import Mapper, Odometry, Source
from rhs.api.errors import RhsError
from rhs.api.floorplan import World, truth_grid
from rhs.api.frozen import freeze
from rhs.api.geometry import inverse, planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, Capture, Closure, Motion, Observation, Revision, Scan, Tracking, Twist, View
from rhs.api.validate import check_capture

SURE = 1e-6 * np.eye(6)  # metres^2, radians^2


class Watched:
    """A source whose survey has been taken once, without its degradations, and is shown again, view by view; then the source
    itself goes on."""

    leads_ahead = False

    def __init__(self, source: Source, who: str) -> None:
        """who: what the source is called in an error. A source may fill its arrays again: what is kept are copies."""
        self.source = source
        self.taken: list[tuple[Capture, np.ndarray | None, tuple[float, bool]]] = []
        while (capture := source.lead()) is not None:
            truth = source.truth()
            self.taken.append((check_capture(capture, who=who), None if truth is None else np.array(truth),
                               source.clearance_m()))
        self.views_expected: int | None = len(self.taken)
        self.shown = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def lead(self) -> Capture | None:
        if self.shown == len(self.taken):
            return None
        self.shown += 1
        return self.taken[self.shown - 1][0]

    def truth(self) -> np.ndarray | None:
        return self.taken[self.shown - 1][1] if self.taken else self.source.truth()

    def clearance_m(self) -> tuple[float, bool]:
        return self.taken[self.shown - 1][2] if self.taken else self.source.clearance_m()

    def begin_patrol(self) -> None:
        self.taken = []
        self.source.begin_patrol()


class TrueDrive:
    """A source whose robot carries out its commands exactly. Where that would end in a wall it drives as it can."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def drive(self, command: Twist) -> Capture:
        truth = self._source.truth()
        assert truth is not None
        travel = command.travel
        try:
            self._source.teleport(se2(*planar(truth)) @ se2(*travel))
        except RhsError:  # no room there: contact is the source's business
            return self._source.drive(command)
        seen = self._source.drive(Twist(0.0, 0.0, command.duration_s))
        return replace(seen, command=command, travel=freeze(travel))


class TrueOdometry:
    """True motions. Of the part itself: how it wants to be driven and, where no sensor gives them, its scans and walls."""

    def __init__(self, odometry: Odometry, source: Source, *, scans: bool) -> None:
        self._odometry, self._source, self._scans = odometry, source, scans
        self.keeps_moving, self.short_steps = odometry.keeps_moving, odometry.short_steps
        self.scale_from = odometry.scale_from
        self._poses: list[np.ndarray] = []

    def update(self, observation: Observation) -> Motion:
        truth = self._source.truth()
        assert truth is not None
        said = self._odometry.update(observation) if self._scans else None
        step = inverse(self._poses[-1]) @ truth if self._poses else np.eye(4)
        self._poses.append(truth)
        return Motion(step, SURE, Tracking.OK, scan=said.scan if said else None)

    def revise(self) -> Revision | None:
        said = self._odometry.revise() if self._scans else None
        if said is None:
            return None
        return Revision(np.array(self._poses[:len(said.poses)]), said.scans, said.walls, SURE)


class TrueClosing:
    """The true poses of the survey, from where it began."""

    def __init__(self, truths: Mapping[float, np.ndarray]) -> None:
        """truths: stamp in seconds -> true pose; of views that never arrived too."""
        self._truths = truths

    def close(self, views: Sequence[View]) -> Closure:
        begun = views[0].map_from_body @ inverse(self._truths[views[0].stamp_s])
        return Closure(np.array([begun @ self._truths[view.stamp_s] for view in views]))


class TrueMap:
    """The true plan as it was at the survey, in the cells of the mapper's own map."""

    draws_furniture = True

    def __init__(self, mapper: Mapper, world: World) -> None:
        self._mapper, self._world = mapper, world

    def update(self, map_from_body: np.ndarray, scan: Scan) -> None:
        self._mapper.update(map_from_body, scan)

    def grid(self) -> OccupancyGrid:
        return truth_grid(self._world, self._mapper.grid().resolution_m)

    def reset(self) -> None:
        self._mapper.reset()


class TrueLocaliser:
    """Always right and sure."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """It needs no places."""

    def start(self, belief: Belief | None) -> None:
        """Wherever it is told to be."""

    def update(self, observation: Observation, motion: Motion) -> Belief:
        truth = self._source.truth()
        assert truth is not None
        return Belief(freeze(se2(*planar(truth))), SURE)
