"""What strangers' parts share with one another and with whoever judges them: buffers, arrays of metrics, maps, columns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from installing import FAKES, installed

import rhs
from rhs.api.errors import ContractError, RhsError
from rhs.api.geometry import camera_from_fov
from rhs.api.grid import OccupancyGrid
from rhs.api.metric import Metric
from rhs.api.records import Belief, Capture, Closure, LoopEdge, Motion, Observation, Path, PlanReason, Tracking
from rhs.api.validate import check_belief, check_capture, check_closure, check_motion, check_observation
from rhs.config import registry
from rhs.config.compose import config_hash, from_plain, read_values
from rhs.config.degraded import Degraded
from rhs.metrics.evaluate import evaluate
from rhs.patrol.mission import MissionSettings
from rhs.patrol.planning import RoomyPlanner
from rhs.runfolder.row import read_row

pytestmark = pytest.mark.usefixtures("afresh")
CHAIN = {kind: "fake" for kind in ("source", "sensor", "odometry", "loop_closer", "mapper", "planner", "localiser")}
LIGHT = CHAIN | {"recording": "off", "pictures": "off"}


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


def test_a_view_stays_as_it_was_when_its_camera_fills_the_buffer_again():
    """The pictures of many engines are views, RGB of RGBA, of one buffer for all of them."""
    buffer, depth, imu = np.zeros((6, 8, 4), np.uint8), np.ones((2, 6, 8), np.float32), np.ones((2, 3))
    capture = check_capture(Capture(0, 0.0, buffer[:, :, :3], depth[0], extras={"imu": imu[0]}), who="x")
    camera = camera_from_fov(8, 6, 60.0, height_m=1.0)
    seen = Observation(0, 0.0, camera, buffer[:, :, :3], depth[0], extras={"imu": imu[0]})
    seen = check_observation(seen, capture, who="x")
    buffer[:], depth[:], imu[:] = 9, 9.0, 9.0
    for kept in (capture, seen):
        assert (kept.image.max(), kept.depth.max(), kept.extras["imu"].max()) == (0, 1.0, 1.0)
        assert not (kept.image.flags.writeable or kept.depth.flags.writeable or kept.extras["imu"].flags.writeable)


def test_a_picture_of_its_own_is_not_copied():
    image = np.zeros((6, 8, 3), np.uint8)
    read = np.frombuffer(bytes(6 * 8 * 3), np.uint8).reshape(6, 8, 3)
    assert all(check_capture(Capture(0, 0.0, one), who="x").image is one for one in (image, read))


@pytest.mark.parametrize("name", ["status", "probability", "reason", "replaced"])
def test_a_detail_does_not_take_the_place_of_what_the_record_says(name):
    """steps.csv had it under one name: a detail `probability` was the stated chance of every metric."""
    motion, belief = Motion(np.eye(4), np.eye(6), Tracking.OK), Belief(np.eye(4), np.eye(6))
    record, check = (belief, check_belief) if name == "probability" else (motion, check_motion)
    with pytest.raises(ContractError, match=f"x=mine: details.'{name}'. is 0.5; expected another name"):
        check(replace(record, details={name: 0.5}), who="x=mine")


@dataclass
class Closes:
    """Finds a loop, and says so in NumPy's numbers."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def close(self, views):
        edge = LoopEdge(np.int64(0), np.int64(len(views) - 1), np.eye(4), np.eye(6), np.int64(9), np.bool_(True))
        return closure_of(views, (edge,), {"cost": np.float32(2.0)})


def closure_of(views, edges, details=None):
    return Closure(np.stack([view.map_from_body for view in views]), edges, details or {})


@dataclass
class Plans:
    """Goes straight, in times of NumPy."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        return Path(PlanReason.OK, [problem.start_m, problem.goal_m], plan_ms=np.float32(1.0), learn_ms=np.int64(2))


def test_numbers_of_numpy_are_numbers(tmp_path):
    row = rhs.run({**LIGHT, "loop_closer": Closes(), "planner": Plans(), "output": str(tmp_path / "run")}, quiet=True)
    assert (row["status"], row["success"]) == ("ok", 1.0)
    assert rhs.load_run(tmp_path / "run").json("closure")["edges"][0]["inliers"] == 9


@dataclass
class Source32:
    """The room, its facts in NumPy's numbers and arrays."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "driving", "command", "wheel"})
    image_width: int = 32
    views: int = 3
    delay_s: float = 0.0

    def build(self, context):
        from rhs_fakes.room import Room

        room = Room(self, context)
        room.camera = replace(room.camera, width=np.int64(room.camera.width))
        room.facts = replace(room.facts, bounds_m=np.array(room.facts.bounds_m, np.float32), robot_radius_m=np.float32(0.2))
        return room


def test_a_source_that_speaks_numpy_is_recorded(tmp_path):
    words = LIGHT | {"source": Source32(), "recording": "full", "task": "survey", "output": str(tmp_path / "run")}
    assert rhs.run(words, quiet=True)["status"] == "ok"


def test_edges_that_are_none_are_told():
    views = [SimpleNamespace(map_from_body=np.eye(4))]
    with pytest.raises(ContractError, match="x=mine: edges is of type NoneType; expected a tuple of LoopEdge"):
        check_closure(closure_of(views, None), views, who="x=mine")


def spoils(run):
    run.trajectory("estimate").poses[:] = 0.0
    run.json("facts")["name"] = "spoilt"
    return 1.0


def test_metrics_of_two_strangers_cannot_change_what_the_other_reads(tmp_path):
    rhs.run({**LIGHT, "task": "survey", "output": str(tmp_path / "run")}, quiet=True)
    registry.register("metric", "a_mine", (Metric("spoils_m", "m", "x", "mine", spoils),))
    registry.register("metric", "b_mine", (
        Metric("last_m", "m", "x", "mine", lambda run: run.estimate.poses[-1, 0, 3]),
        Metric("name", "", "x", "mine", lambda run: run.json("facts")["name"], word=True)))
    values = evaluate(tmp_path / "run", "survey")
    assert (values["spoils_m"], values["name"]) == (1.0, "room") and values["last_m"] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(("value", "stands", "says"), [
    ("n/a", None, "mine_m is 'n/a', expected a number"), (np.zeros(2), None, "holds a ndarray"), (2**70, None, "63 bits"),
    ({}, None, "holds a dict"), (True, 1, ""), (np.bool_(False), 0, ""), (np.array(1.5), 1.5, ""), (None, None, "")])
def test_a_figure_that_no_row_can_hold_costs_its_own_column(tmp_path, value, stands, says):
    """Whoever read the row back refused it whole, and the run was in no table."""
    registry.register("metric", "mine", (Metric("mine_m", "m", "x", "mine", lambda run: value, tasks=()),))
    rhs.run({**LIGHT, "task": "survey", "output": str(tmp_path / "run")}, quiet=True)
    row = read_row(tmp_path / "run/row.json")
    assert row["mine_m"] == stands and says in (row.get("metric_failures") or "")
    assert len(rhs.table(tmp_path / "run")) == 1


def test_a_metric_takes_no_column_of_a_task(tmp_path):
    registry.register("metric", "mine", (Metric("plan_wall_ms", "ms", "x", "mine", lambda run: 0.0, tasks=()),))
    row = rhs.run(["task=planning", "world=map1", "planner=astar", "pictures=off", f"output={tmp_path / 'run'}"], quiet=True)
    assert row["plan_wall_ms"] > 0.0 and "plan_wall_ms of mine: there is a column of that name" in row["metric_failures"]


class Driven:
    """A source that moves one pose on, whose robot touches something at its second view."""

    def __init__(self):
        self.camera, self.pose, self.count = camera_from_fov(8, 6, 60.0, height_m=1.0), np.eye(4), -1

    def lead(self):
        self.count += 1
        self.pose[0, 3] += 0.5
        return Capture(self.count, float(self.count), travel=np.array([0.5, 0.0, 0.0]), contact=self.count == 1)

    def truth(self):
        return self.pose


def test_a_view_that_is_lost_takes_no_touch_and_no_way_with_it():
    ways = []

    def degrade(capture, moved):
        ways.append(moved[0, 3])
        return None if capture.index == 1 else capture

    source = Degraded(Driven(), [("degrade=mine", SimpleNamespace(told=lambda camera: camera, degrade=degrade))])
    assert source.lead().contact is False
    arrived = source.lead()
    assert (arrived.index, arrived.travel[0], arrived.contact) == (2, 1.0, True)
    assert ways == [0.0, 0.5, 0.5]  # the truth that was moved on is not the one of before


def test_a_degradation_that_loses_every_view_is_named():
    lost = SimpleNamespace(told=lambda camera: camera, degrade=lambda capture, moved: None)
    source = Driven()
    source.lead = iter([Capture(0, 0.0), Capture(1, 1.0), None]).__next__
    with pytest.raises(RhsError, match="degrade=mine: all 2 views were lost"):
        Degraded(source, [("degrade=mine", lost)]).lead()


class Forges:
    """Clears the map it is given and goes straight."""

    def plan(self, problem):
        problem.blocked.setflags(write=True)
        problem.blocked[:] = False
        return Path(PlanReason.OK, np.stack([problem.start_m, problem.goal_m]))


def test_a_planner_in_a_patrol_is_judged_on_a_map_of_our_own():
    free = np.ones((40, 40), bool)
    free[:, 20] = False
    grid = OccupancyGrid(np.where(free, 0.0, 1.0), 0.1, (0.0, 0.0))
    planner = RoomyPlanner(Forges(), grid, free, radius_m=0.2, settings=MissionSettings(), who="planner=mine")
    with pytest.raises(ContractError, match="planner=mine: the path is blocked near"):
        planner.plan(np.array([1.05, 2.05]), np.array([3.05, 2.05]), obstacles=np.zeros_like(free),
                     things_m=np.empty((0, 2)))


@dataclass
class Resolves:
    """A planner that makes up its mind as it is built."""

    limit: float | None = None
    """of something"""
    weights: list[float] = field(default_factory=list)
    """of each"""
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        self.limit = self.limit or 7.0
        self.weights.append(self.limit)
        return self

    def plan(self, problem):
        assert (self.limit, self.weights) == (7.0, [7.0])  # built anew for each question of task=planning
        return Path(PlanReason.DISCONNECTED, [])


def test_what_a_part_makes_of_its_settings_is_not_what_it_was_asked_for(tmp_path):
    """config.yaml said what was left of them: another run, of another hash."""
    row = rhs.run({"task": "planning", "world": "map1", "planner": Resolves(), "pictures": "off",
                   "output": str(tmp_path / "run")}, quiet=True)
    kept = from_plain(read_values(tmp_path / "run"))
    assert row["status"] == "ok" and row["plan_reason"] == "disconnected"
    assert (kept.planner.settings, config_hash(kept)) == (Resolves(), row["config_hash"])
