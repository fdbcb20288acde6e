"""The work of the tasks survey and patrol: lead, settle, close the loop, draw the map, patrol."""

from __future__ import annotations

import logging
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from rhs.api.floorplan import OBSTACLE_HEIGHT_M, Box, World
from rhs.api.randomness import generator
from rhs.api.records import Belief, Event, MissionStatus, Scan, Step, Tracking, View
from rhs.api.task import Parts, StepJob
from rhs.api.trajectory import Trajectory, write_tum
from rhs.api.validate import reach_of
from rhs.base.errors import ConfigError, RhsError
from rhs.base.memory import hand_back
from rhs.estimation import survey as surveying
from rhs.estimation.scans.mount_fit import heading_doubt, heading_figures, mount_figures
from rhs.estimation.scans.settings import SEES_AROUND_RAD
from rhs.estimation.survey import Survey as Surveyed
from rhs.estimation.survey import ViewCollector
from rhs.estimation.views.camera_fit import contradictions_of, fit_camera
from rhs.estimation.views.features import features
from rhs.estimation.views.settings import CameraFitSettings
from rhs.metrics.success import late_views, wheel_fault
from rhs.worlds.counted import with_counted
from rhs.worlds.maps import save_map
from rhs.worlds.world_checks import walk_fault
from rhs.worlds.world_moving import walkers

from .changed_map import check_updates
from .explore import check_explorable, explored
from .gate import GatedOdometry, gated
from .kidnap import Kidnapper
from .loop import steps
from .mission import turning
from .observers import RunLog, closure_rows, plan_row, write_json, write_reach
from .run import RunContext
from .sentinel import Sentinel
from .shared_survey import led_for_others
from .sights import Sights, check_looks
from .tasks import Patrol, Survey, explores

logger = logging.getLogger("rhs.patrol")
BLIND_SHARE, BLIND_VIEWS = 0.5, 5  # of a survey's views, lost, from more of which its map is that of the wheels
START_VARIANCE = np.array([1e-3, 1e-3, 1e-6, 1e-6, 1e-6, 1e-3])  # of the belief a patrol begins with, if not better


class PatrolJob(StepJob):
    """Survey, settle, close the loop, draw the map, patrol."""

    def __init__(self, settings: Survey, context: RunContext, world: World | None) -> None:
        self.settings, self.context, self.world = settings, context, world
        self.patrol = settings if isinstance(settings, Patrol) and world is not None else None  # no recording can be driven
        idle = set(Patrol.kinds) - set(Survey.kinds) if self.patrol is None and not explores(settings) else ()
        self.parts = context.parts(world=world, without=idle)
        sensed = context.settings("sensor").provides
        if self.patrol is not None and "driving" not in self.parts.provides:
            raise ConfigError(f"task=patrol drives the robot, which {self.parts.who['source']} cannot do here; "
                              "type task=survey for the map alone")
        if explores(settings):
            check_explorable(self.parts, sensed)
        if self.patrol is not None and self.patrol.mission.update_map:
            check_updates(self.parts, sensed)
        if self.patrol is not None and self.patrol.mission.look_m:
            check_looks(self.patrol.mission.look_m, sensed)
            if context.config.pictures == "off":
                logger.warning("mission.look_m compares pictures, and pictures=off: nothing is compared; type pictures=on")
        self.ungated = self.parts.odometry
        if context.shared is not None:
            self.parts.odometry = context.shared.odometry
        elif "odometry" in context.config.parts:
            self.parts.odometry = gated(self.parts.odometry, context.settings("odometry").needs, settings.gate,
                                        self.parts.who["odometry"], timed=self.parts.source.timed)

    def steps(self) -> Iterator[Step]:
        """Both phases; the row's columns follow from the files they leave."""
        log = self.context.open_log(self.parts, self.world)
        settings, sights = self.settings, None
        if self.patrol is not None and self.context.config.pictures != "off":
            sights = Sights(settings.places.every, self.context.features, self.patrol.mission.look_m)
        if self.context.shared is not None:
            survey = self.context.shared.hand_over(log)
        else:
            leading = lead_survey(self.parts, self.context, settings, log, sights=sights)
            if self.context.keep is None:
                survey = yield from leading
            else:
                shared = yield from led_for_others(leading, self.parts, self.context, log, ungated=self.ungated,
                                                   recorded=self.context.config.recording != "off")
                self.context.keep(shared)
                survey = shared.survey
        if self.patrol is not None and self.world is not None:
            if not self.parts.source.facts.places:
                logger.warning("%s names no places, so nothing is patrolled after the survey; write places: {desk: [x, y]} "
                               "in its file", self.world.name)
            yield from patrol(self.parts, self.patrol, survey, log, seed=self.context.seed, sights=sights)


def world_of(settings: Survey, context: RunContext) -> World | None:
    """The building, and what is put into it when a patrol begins; None for a recording."""
    world = context.floor_plan()
    return since_survey(world, settings, context.seed) if world is not None and isinstance(settings, Patrol) else world


def since_survey(world: World, settings: Patrol, seed: int) -> World:
    """The world with all that is otherwise when the patrol begins. Raises ConfigError for what cannot stand there."""
    world = with_people(with_obstacles(world, settings.obstacles, at_start=explores(settings)), settings.people)
    return with_counted(world, seed, obstacles=settings.obstacle_count, moved=settings.moved_count,
                        people=settings.people_count)


def with_obstacles(world: World, boxes: list[list[float]], *, at_start: bool = False) -> World:
    """The world with boxes that the survey does not see. at_start: where the robot waits for the patrol, which is the end of
    the route otherwise. Raises ConfigError if one would be put on the waiting robot."""
    end = np.array(world.start[:2] if at_start else world.route_m[-1])
    for x, y, width, depth in boxes:
        gap_m = float(np.hypot(*np.maximum(np.abs(end - (x, y)) - (width / 2, depth / 2), 0.0)))
        if gap_m < world.robot_radius_m:
            raise ConfigError(f"obstacles: the box at ({x:g}, {y:g}) would be put in {gap_m:.2f} m from the robot waiting "
                              f"at ({end[0]:g}, {end[1]:g}); its radius is {world.robot_radius_m:g} m")
    more = tuple(Box(f"obstacle_{i + 1}", (x, y), (width, depth, OBSTACLE_HEIGHT_M))
                 for i, (x, y, width, depth) in enumerate(boxes))
    return replace(world, obstacles=world.obstacles + more)


def with_people(world: World, paths_m: Sequence[Sequence[float]]) -> World:
    """The world with people on closed paths besides those it has. Raises ConfigError for a path through a wall or a box."""
    people = walkers(paths_m)
    for person in people:
        if fault := walk_fault(world, person):
            raise ConfigError(f"people: {fault}")
    return replace(world, moving=replace(world.moving, people=world.moving.people + people)) if people else world


def lead_survey(parts: Parts, context: RunContext, settings: Survey, log: RunLog, *, sights: Sights | None = None,
                ) -> Generator[Step, None, Surveyed]:
    """Lead, settle, close the loop, draw the map; the files of the survey are written here. sights: keeps its pictures."""
    collected = yield from collect(parts, context, settings, log, sights=sights)
    hand_back()
    survey = settle(collected, parts, log)
    if "driving" not in parts.provides:  # a simulator knows its camera
        check_camera(survey.views, settings.camera_fit, log.folder, rng=generator(context.seed, "camera_fit"))
    if sights is not None:
        sights.settle(survey.views)
    return survey


def collect(parts: Parts, context: RunContext, settings: Survey, log: RunLog, *, sights: Sights | None = None,
            ) -> Generator[Step, None, ViewCollector]:
    """Lead the camera along its route, or let the robot explore; the views as they were believed on the way."""
    places = settings.places
    collector = ViewCollector(places.every, context.features, features, places.most_mb, folder=log.folder)
    if explores(settings):
        visit = parts.source.facts.places if isinstance(settings, Patrol) else ()
        views = log.follow(explored(parts, settings.mission, log.folder, visit=visit), "survey", None)
    else:
        views = log.follow(context.lead(parts), "survey", parts.source.views_expected)
    led = collector.watch(views)
    yield from led if sights is None else sights.watch(led)
    if not len(collector.views):
        raise RhsError(f"{parts.who['source']}: lead() gave no view; expected at least one")
    return collector


def settle(collected: ViewCollector, parts: Parts, log: RunLog) -> Surveyed:
    """What the odometry settles on, the loop closed, the map drawn, and their files."""
    begin = time.perf_counter()
    reach_m, who = reach_of(parts.source.facts), parts.who
    revised, walls = surveying.revise(collected.views, parts.odometry, who=who["odometry"], reach_m=reach_m)
    views, closure = surveying.close(revised, parts.loop_closer, who=who["loop_closer"], reach_m=reach_m)
    hand_back()
    grid = surveying.draw(views, parts.mapper, who=who["mapper"])
    closing_ms = 1e3 * (time.perf_counter() - begin)
    stamps = np.array([view.stamp_s for view in views])
    write_tum(log.folder / "corrected.tum", Trajectory(stamps, closure.poses))
    if len(collected.own_stamps_s) == len(views):
        write_tum(log.folder / "corrected_log.tum", Trajectory(np.array(collected.own_stamps_s), closure.poses))
    save_map(log.folder / "map", grid)
    log.recorder.map(grid, float(stamps[-1]))
    if walls:
        write_json(log.folder / "walls.json", surveying.wall_rows(surveying.carried(walls, revised, closure)))
    figures = {"closing_ms": closing_ms, **contradictions(revised, views)}
    if isinstance(parts.odometry, GatedOdometry):
        figures["views_late_s"] = parts.odometry.views_late_s()
    if "driving" not in parts.provides:  # a simulator knows where its laser sits
        figures |= mount_figures(scans_around(views) or (), collected.wheels)
        figures |= heading_figures(closure.poses, collected.wheels)
        if turned := heading_doubt(figures):
            logger.warning("%s", turned)
        figures |= parts.odometry.wheel_figures() if isinstance(parts.odometry, GatedOdometry) else {}
        if fault := wheel_fault(figures) or late_views(figures):
            logger.warning("%s", fault)
    elif blind := saw_nothing(views, parts):
        logger.warning("%s", blind)
    write_json(log.folder / "closure.json", closure_rows(closure) | figures)
    return Surveyed(views, closure, grid)


def saw_nothing(views: Sequence[View], parts: Parts) -> str:
    """What to say of a survey most of which a depth camera was led through by the wheels alone; empty of any other. A
    degradation that was typed is the first thing to leave out; surfaces without a pattern are only a guess."""
    lost = sum(view.motion.status is Tracking.LOST for view in views)
    if "depth" not in parts.provides or lost <= max(BLIND_SHARE * len(views), BLIND_VIEWS):
        return ""
    fused = "" if "fused" in parts.who["odometry"] else ", or try odometry=fused, which takes walls to stand square"
    typed = parts.who.get("degrade")
    why, way = (f"its pictures were spoiled by {typed}", "without it a run shows whether it is the reason") if typed \
        else ("surfaces without a pattern?", "try sensor=laser, which goes by the walls")
    return (f"the odometry had nothing to follow in {lost} of {len(views)} views of the survey ({why}): the map, and what "
            f"is believed in it, is as wrong as the wheels; {way}{fused}")


def check_camera(views: Sequence[View], settings: CameraFitSettings, folder: Path, *, rng: np.random.Generator) -> None:
    """Write camera_fit.json, for the metrics alone, and warn where the views of a recording clearly contradict the camera
    that somebody told. Nothing is changed by it: who typed a camera types another one."""
    fit = fit_camera(views, rng=rng, settings=settings)
    if fit is None:
        return
    write_json(folder / "camera_fit.json", asdict(fit))
    for line in contradictions_of(fit, views[0].camera, settings):
        logger.warning("%s", line)


def contradictions(before: Sequence[View], closed: Sequence[View]) -> dict[str, float]:
    """What the map of a laser says against itself, before and after closing; nothing for a camera, which sees too little at
    once."""
    scans = scans_around(closed)
    if scans is None:
        return {}
    from rhs.estimation.scans.inconsistency import map_inconsistency  # compiled code
    from rhs.estimation.scans.planar_poses import flat

    values = {name: map_inconsistency(scans, flat(np.array([view.map_from_body for view in views])))
              for name, views in (("map_inconsistency", closed), ("map_inconsistency_before_closing", before))}
    return {name: value for name, value in values.items() if np.isfinite(value)}


def scans_around(views: Sequence[View]) -> list[Scan | None] | None:
    """What the sensor measured in each view; None where that is no scan, or one that sees too little at once."""
    measured = (view.scan for view in views if view.scan is not None and view.motion.scan is None)
    first = next(measured, None)  # one sensor measured all of them
    if first is None or np.ptp(first.bearings_rad) < SEES_AROUND_RAD:
        return None
    return [view.scan if view.motion.scan is None else None for view in views]


def patrol(parts: Parts, settings: Patrol, survey: Surveyed, log: RunLog, *, seed: int, sights: Sights | None = None,
           ) -> Iterator[Step]:
    """Visit the places in order in the surveyed map; at each, compare with what the survey saw there."""
    facts = parts.source.facts
    write_reach(log, parts.source.truth())
    parts.localiser.learn(survey.views, survey.grid)
    last = survey.views[-1]
    sure = np.clip(np.diag(last.covariance), 1e-6, START_VARIANCE)
    parts.localiser.start(Belief(last.map_from_body, np.diag(sure)))
    sentinel = Sentinel(parts, survey.grid, survey.views, places=facts.places, radius_m=facts.robot_radius_m,
                        footprint=facts.footprint, settings=turning(settings.mission, parts.odometry))
    if settings.mission.kidnap:
        sentinel.kidnapper = Kidnapper(generator(seed, "kidnapper"), survey.views)
    loop = steps(parts.source, parts.sensor, parts.odometry, sentinel, first_index=len(survey.views),
                 after_s=last.stamp_s, who=parts.who)
    try:
        for step in log.follow(loop, "patrol", None):
            if Event.ARRIVED in step.events:
                picture = take_picture(step, sentinel, log.folder / "places")
                if sights is not None:
                    sights.compare(step, picture, log.folder / "places_before", rng=generator(seed, "sights"))
            elif sights is not None:
                sights.look(step, seed=seed)
            yield step
    finally:
        write_json(log.folder / "missions.json", [asdict(mission) for mission in sentinel.book.missions])
        if sights is not None:
            write_json(log.folder / "changes.json", [*sights.rows, *sights.on_way(log.folder / "on_way")])
        write_json(log.folder / "plans.json", [plan_row(number, plan) for number, plan in sentinel.plans])
        if sentinel.changed is not None:
            save_map(log.folder / "map_patrol", sentinel.changed.grid)


def take_picture(step: Step, sentinel: Sentinel, folder: Path) -> str:
    """The picture the sentinel was sent for, named after the place; its name."""
    from rhs.estimation.views.features import write_image

    arrived = [mission for mission in sentinel.book.missions if mission.status is MissionStatus.ARRIVED]
    name = f"{len(arrived):02d}_{arrived[-1].place}"
    if step.observation.image is not None:
        folder.mkdir(exist_ok=True)
        write_image(folder / f"{name}.png", step.observation.image)
    return name
