"""The localise task: a map that is given, a drive through it, and a localiser that says where it is.

Per view: sense, odometry (the loop of a survey), then the localiser. Files of the run folder: those of the loop (steps.csv,
localised.tum, truth_localised.tum, run.mcap), map.yaml and map.pgm (the map as given), localise.json, row.json. The columns
follow from them (rhs.metrics.localise); true poses are moved into the frame of the map before they are written.
"""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rhs.api.contracts import Source
from rhs.api.errors import ConfigError, RhsError
from rhs.api.files import replacing
from rhs.api.geometry import se2
from rhs.api.records import Belief, BeliefStatus, Capture, Event, Scan, Step, Tracking
from rhs.api.task import StepJob, TaskContext
from rhs.api.validate import check_belief, reach_of
from rhs.estimation.scans.mount_fit import heading_doubt, heading_figures, mount_figures
from rhs.worlds.maps import save_map

from .given_map import read_given, surveyed
from .map_size import map_size_ratio, size_doubt
from .settings import Localise

log = logging.getLogger("rhs.localise")
PHASE = "localise"
MEASURES = frozenset({"scan", "depth", "cloud", "right_image"})  # what metres are seen by: wheels may count others


class LocaliseJob(StepJob):
    """Learn the map, follow the drive, believe."""

    def __init__(self, settings: Localise, context: TaskContext) -> None:
        self.settings, self.context = settings, context
        self.given = read_given(settings.map)
        self.parts = context.parts()
        if self.parts.slam is not None:
            raise ConfigError("task=localise takes a map that is given, which a slam makes for itself; leave out slam=")
        self.pictures = "image" in context.settings("localiser").needs
        if self.pictures and not self.given.has_pictures:
            raise ConfigError(f"{self.parts.who['localiser']} recognises places, and map={settings.map} holds no pictures "
                              "of any; type map=RUN_FOLDER of a survey with recording=full, or "
                              "localiser=particle_filter_scan")
        if not context.settings("localiser").needs and settings.start == "unknown":
            raise ConfigError(f"{self.parts.who['localiser']} looks at nothing (its needs are empty), so it cannot find "
                              "itself from start=unknown; type localiser=particle_filter_scan, or start=[x_m,y_m,yaw_deg]")
        self.scans: list[Scan | None] = []  # as measured, and the travel (3,) of the wheels since the view before
        self.wheels: list[np.ndarray | None] = []
        self.poses: list[np.ndarray] = []  # map_from_body (4, 4) as believed, and whether it was sure of that
        self.sure: list[bool] = []
        self.motions: list[np.ndarray] = []  # previous_from_body (4, 4), and whether they join two such beliefs
        self.follows: list[bool] = []
        self.figures: dict[str, float] = {}
        self.source: Source = self.parts.source
        if settings.kidnap_every_m:
            self.source = self.parts.source = CarriedOff(self.source, settings.kidnap_every_m, settings.kidnap_skip_m)

    def steps(self) -> Iterator[Step]:
        """Every view of the drive, believed by the localiser; the row's columns follow from the files they leave."""
        save_map(self.context.folder / "map", self.given.grid)
        self.parts.localiser.learn(surveyed(self.given, self.context.features, pictures=self.pictures), self.given.grid)
        self.write_note()
        led = self.believed(self.context.lead(self.parts))
        yield from self.context.follow(led, PHASE, self.source.views_expected)
        if self.context.settings("odometry").needs & MEASURES:
            ratio = map_size_ratio(self.poses, self.motions, self.follows)
            self.write_note({"map_size_ratio": ratio} if np.isfinite(ratio) else {})
            if doubt := size_doubt(ratio, self.given.grid.resolution_m):
                log.warning("%s", doubt)
        if "driving" not in self.parts.provides:  # a simulator knows where its laser sits
            sure = [wheel if known else None for wheel, known in zip(self.wheels, self.sure, strict=True)]
            figures = mount_figures(self.scans, self.wheels) | heading_figures(np.array(self.poses), sure)
            self.write_note(figures)
            if turned := heading_doubt(figures):
                log.warning("%s", turned)

    def believed(self, led: Iterator[Step]) -> Iterator[Step]:
        """The steps with the localiser's belief in the place of the sum of the odometry, and with the truth in the map."""
        begin, way_m = True, 0.0
        reach_m = reach_of(self.source.facts) + float(np.abs(self.given.grid.origin_m).max())
        for step in led:
            way_m += float(np.hypot(*step.motion.previous_from_body[:2, 3]))
            begin = begin or 0.0 < self.settings.restart_every_m <= way_m
            events = [Event.STARTED] if begin else []
            truth = None if step.truth is None else self.given.in_map(step.truth)
            if begin:
                self.parts.localiser.start(first_belief(self.settings, truth))
                begin, way_m = False, 0.0
            if isinstance(self.source, CarriedOff) and self.source.fresh:
                events.append(Event.KIDNAPPED)
            self.scans.append(step.observation.scan)
            self.wheels.append(None if Event.KIDNAPPED in events else step.observation.wheel)
            clock = time.perf_counter()
            belief = self.parts.localiser.update(step.observation, step.motion)
            belief = check_belief(belief, who=self.parts.who["localiser"], reach_m=reach_m)
            self.poses.append(belief.map_from_body)
            sure, before = belief.status is BeliefStatus.TRACKING, bool(self.sure) and self.sure[-1]
            self.sure.append(sure)
            self.motions.append(step.motion.previous_from_body)
            self.follows.append(sure and before and not events and step.motion.status is Tracking.OK)
            spent = {**step.timings_ms, "localise": 1e3 * (time.perf_counter() - clock)}
            yield replace(step, phase=PHASE, belief=belief, truth=truth, events=tuple(events), timings_ms=spent)

    def write_note(self, figures: Mapping[str, float] | None = None) -> None:
        """localise.json: which map, how bent it is by the truth of the survey behind it; figures: its size, how the laser
        sits, added to those that were written before."""
        misfit_m = self.given.misfit_m if np.isfinite(self.given.misfit_m) else None
        self.figures |= figures or {}
        with replacing(self.context.folder / "localise.json") as file:
            file.write(json.dumps({"map": self.settings.map, "map_misfit_m": misfit_m, **self.figures}, indent=1) + "\n")


def first_belief(settings: Localise, truth: np.ndarray | None) -> Belief | None:
    """What the localiser is told at the start: a pose, or None, nothing. truth: map_from_body (4, 4) of the view. Raises
    RhsError where that is asked for and not known."""
    if settings.start == "unknown":
        return None
    if settings.start == "known":
        if truth is None:
            raise RhsError("start=known: nobody knows the true pose of the first view; type start=[x_m,y_m,yaw_deg], "
                           "start=unknown, or source.truth=FILE.tum")
        pose = np.array(truth)
    else:
        x_m, y_m, yaw_deg = settings.start
        pose = se2(x_m, y_m, float(np.radians(yaw_deg)))
    sigma = np.array([settings.start_sigma_m] * 2 + [1e-3] * 3 + [np.radians(settings.start_sigma_deg)])
    return Belief(pose, np.diag(sigma**2))


class CarriedOff:
    """The source, less a stretch of skip_m after every every_m of way, both by the truth, else by its wheels: the robot is
    carried off and told nothing. What the wheels counted from view to view stays: in the air they do not turn."""

    leads_ahead = False  # `fresh` is asked for after each view

    def __init__(self, source: Source, every_m: float, skip_m: float) -> None:
        self._source, self._every_m, self._skip_m = source, every_m, skip_m
        self._way_m = 0.0
        self._last: np.ndarray | None = None
        self.fresh = False  # the last view is the first one elsewhere

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def lead(self) -> Capture | None:
        capture = self._next()
        self.fresh = self._way_m >= self._every_m
        if self.fresh:
            self._way_m = 0.0
            while capture is not None and self._way_m < self._skip_m:
                capture = self._next()
            self._way_m = 0.0
        return capture

    def _next(self) -> Capture | None:
        """The next view of the source; its way is added."""
        capture = self._source.lead()
        if capture is None:
            return None
        truth, before = self._source.truth(), self._last
        self._last = None if truth is None else np.array(truth)  # a source may move its own pose on
        if truth is not None and before is not None:
            self._way_m += float(np.linalg.norm(truth[:2, 3] - before[:2, 3]))
        elif capture.travel is not None:
            self._way_m += float(np.hypot(*capture.travel[:2]))
        elif truth is None and capture.index > 0:
            raise RhsError("kidnap_every_m counts true way, or that of wheels, and this recording has neither; leave it out")
        return capture
