"""Tasks, sources, degradations and metrics of people who know only the README: whose fault it is, and on which line."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from installing import FAKES, installed

import rhs
from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import camera_from_fov
from rhs.api.metric import Metric
from rhs.api.records import Capture, Motion, Scan, Tracking, WorldFacts
from rhs.api.validate_source import check_clearance, check_facts, check_provides
from rhs.blame.oracles import Watched
from rhs.cli import check
from rhs.config import loose, registry
from rhs.config.compose import compose_config
from rhs.config.degraded import Degraded
from rhs.metrics.evaluate import evaluate
from rhs.patrol.observers import drives_in
from rhs.worlds.world import load_world

pytestmark = pytest.mark.usefixtures("afresh")
LIGHT = ["source=fake", "sensor=fake", "odometry=fake", "recording=off", "pictures=off"]


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


@dataclass
class Mine:
    """A task that goes wrong."""

    answer: str = ""
    """what it returns"""
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()
    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor", "odometry")

    def build(self, context):
        return Work(self.answer, context.parts())


class Work:
    def __init__(self, answer, parts):
        self.answer = answer

    def run(self):
        if self.answer == "raises":
            raise KeyError("of mine")
        if self.answer == "exits":
            raise SystemExit(0)
        return {"status": "failed", "seed": 7, "mine_m": 1.0, "array": np.zeros(2)}


def row_of(tmp_path, answer: str) -> dict[str, Any]:
    rhs.register("task", "mine", Mine)
    return rhs.run(["task=mine", f"answer={answer}", *LIGHT, f"output={tmp_path / 'run'}"], quiet=True)


@pytest.mark.parametrize(("answer", "says"), [("raises", "KeyError: 'of mine'"), ("exits", "SystemExit: 0")])
def test_a_task_that_fails_is_named_with_its_line(tmp_path, answer, says):
    reason = row_of(tmp_path, answer)["reason"]
    assert reason.startswith("task=mine (") and "test_strangers_kinds.py:" in reason and reason.endswith(says)


def test_a_task_does_not_say_how_the_run_ended(tmp_path):
    row = row_of(tmp_path, "columns")
    assert (row["status"], row["seed"], row["mine_m"]) == ("ok", 0, 1.0)
    assert all(f"{name}: " in row["row_failures"] for name in ("array", "seed", "status"))


def test_a_setting_of_a_task_typed_as_that_of_a_part_is_told_where_it_stands():
    with pytest.raises(ConfigError, match="a task's settings stand at the top level: start=VALUE"):
        compose_config(["task=planning", "task.start=[1,2]"])


def test_a_metric_that_exits_costs_its_own_column(tmp_path):
    def exits(run):
        raise SystemExit(0)

    registry.register("metric", "mine", (Metric("out_m", "m", "x", "mine", exits, tasks=()),
                                         Metric("kept_m", "m", "x", "mine", lambda run: 2.0, tasks=())))
    values = evaluate(tmp_path, "planning")
    assert values["kept_m"] == 2.0 and values["metric_failures"].startswith("out_m: SystemExit: 0 (test_strangers_kinds.py:")


METRIC = "from rhs.api.metric import Metric\nONE = Metric('one_m', 'm', 'x', 'y', lambda run: 1.0)\n"


@pytest.mark.parametrize("held", ["ONE", "[ONE]", "(ONE,)"])
def test_metrics_of_a_file_count_alone_in_a_list_and_in_a_tuple(tmp_path, held):
    (tmp_path / "mine.py").write_text(METRIC + f"MORE = {held}\ndel ONE\n")
    loose.load_files([str(tmp_path / "mine.py")], [])
    (name,) = (name for name in registry.names("metric") if name.startswith("mine_"))
    assert name.endswith("_more") and registry.load("metric", name)[0].name == "one_m"


@pytest.mark.parametrize("held", ["(ONE, 7)", "[Metric('two_m', 'm', 'x', 'y', 'no function')]"])
def test_what_is_no_metric_among_metrics_is_refused(tmp_path, held):
    (tmp_path / "mine.py").write_text(METRIC + f"MORE = {held}\n")
    with pytest.raises(ConfigError, match="mine.py: MORE holds .*expected a tuple of rhs.api.metric.Metric"):
        loose.load_files([str(tmp_path / "mine.py")], [])


CAMERA = camera_from_fov(8, 6, 60.0, height_m=1.0)
WHOLE = Capture(3, 1.5, image=np.zeros((6, 8, 3), np.uint8), depth=np.ones((6, 8), np.float32))


class Views:
    """A source of one capture."""

    def __init__(self):
        self.camera, self.left = CAMERA, [WHOLE]

    def lead(self):
        return self.left.pop() if self.left else None

    def truth(self):
        return None


@pytest.mark.parametrize(("change", "says"), [
    ({"index": 4}, "index is 4; expected 3"), ({"stamp_s": 1.6}, "stamp_s is 1.6; expected 1.5"),
    ({"image": None}, "image is None; expected one"), ({"image": WHOLE.image[::2], "depth": WHOLE.depth[::2]},
                                                       r"image is of shape \(3, 8, 3\); expected")])
def test_a_degradation_is_blamed_for_what_it_left_of_a_view(change, says):
    one = SimpleNamespace(told=lambda camera: camera, degrade=lambda capture, moved: replace(capture, **change))
    with pytest.raises(ContractError, match=f"degrade=mine: {says}"):
        Degraded(Views(), [("degrade=mine", one)]).lead()


@pytest.mark.parametrize(("told", "says"), [
    (None, "camera is of type NoneType"), (replace(CAMERA, fx=float("nan")), "camera.fx is nan"),
    (replace(CAMERA, width=4), "told.. says 4x6 pixels; expected 8x6")])
def test_a_degradation_that_tells_no_camera_is_refused_before_anything_runs(told, says):
    with pytest.raises(ConfigError, match=f"degrade=mine: {says}"):
        Degraded(Views(), [("degrade=mine", SimpleNamespace(told=lambda camera: told))])


def test_what_a_source_says_is_checked():
    facts = WorldFacts("x", (0.0, 0.0, 270.0), places=(), bounds_m=(-1.0, -1.0, 1.0, 1.0), robot_radius_m=0.2)
    with pytest.raises(ContractError, match=r"facts.start is \(0.0, 0.0, 270.0\); expected .* a yaw in radians"):
        check_facts(facts, who="source=mine")
    for said in (None, 1.0, (1.0, None)):
        with pytest.raises(ContractError, match=r"source=mine: clearance_m\(\) is "):
            check_clearance(said, who="source=mine")
    assert check_clearance((np.float64(1.0), np.bool_(True)), who="x") == (1.0, True)
    with pytest.raises(ContractError, match="source=mine: provides is 'scan'"):
        check_provides("scan", who="source=mine")


@dataclass
class Ended:
    """An odometry that asks an iterator for more than it has."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        self.left = iter(())
        return self

    def update(self, observation):
        return next(self.left)


def test_next_without_an_end_is_told_with_its_line(tmp_path):
    row = rhs.run({"task": "survey", "source": "fake", "sensor": "fake", "odometry": Ended(), "loop_closer": "fake",
                   "mapper": "fake", "recording": "off", "pictures": "off", "output": str(tmp_path / "run")}, quiet=True)
    assert "odometry=ended (" in row["reason"] and "test_strangers_kinds.py:" in row["reason"]
    assert "StopIteration at step 0" in row["reason"]


def part(**more) -> type:
    """A dataclass of settings that is a planner but for what more says."""
    body = {"needs": frozenset(), "provides": frozenset(), "build": lambda self, context: self} | more
    return dataclass(type("Mine", (), {"__annotations__": {"step_m": float}, "step_m": 1.0} | body))


@pytest.mark.parametrize("wanted", ["numpy", ("numpy>=1.0",), None, (3,)])
def test_modules_that_a_part_requires_are_named_one_by_one(wanted):
    """A text alone was read letter by letter: `pip install n`."""
    with pytest.raises(ConfigError, match="planner=mine: requires is .*; expected a tuple of modules to import"):
        registry.check_requirements("planner", "mine", part(requires=wanted))


def test_modules_that_are_there_are_not_asked_for():
    registry.check_requirements("planner", "mine", part(requires=("numpy", "scipy.spatial", "cv2:opencv-python-headless")))
    with pytest.raises(ConfigError, match="type: pip install no-such"):
        registry.check_requirements("planner", "mine", part(requires=("no_such.part",)))


def test_what_a_part_raises_over_its_settings_is_a_refusal():
    rhs.register("planner", "mine", part(__post_init__=lambda self: self.step_m.nothing))
    with pytest.raises(ConfigError, match="planner: Mine cannot be made: AttributeError: 'float' object has no attribute"):
        compose_config(["planner=mine"])
    with pytest.raises(ConfigError, match="api is '1'; expected the number"):
        rhs.register("planner", "other", part(api="1"))


@dataclass
class Forks:
    """An odometry that forks at one view, and whose child goes on like its parent."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        self.views = 0
        return self

    def update(self, observation):
        self.views += 1
        if self.views == 2:
            os.fork()
        return Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)


def test_the_child_of_a_part_that_forks_writes_nothing_into_the_run(tmp_path):
    process = os.getpid()
    row = rhs.run({"task": "survey", "source": "fake", "sensor": "fake", "odometry": Forks(), "loop_closer": "fake",
                   "mapper": "fake", "recording": "off", "pictures": "off", "source.views": 6,
                   "output": str(tmp_path / "run")}, quiet=True)
    assert os.getpid() == process and row["status"] == "ok"
    steps = (tmp_path / "run/steps.csv").read_text().splitlines()
    assert [line.partition(",")[0] for line in steps] == ["index", "0", "1", "2", "3", "4", "5"]


class Refilled:
    """A source of four scans that stand in one and the same array."""

    def __init__(self):
        self.index, self.ranges, self.pose = 0, np.ones(3), np.eye(4)

    def lead(self):
        if self.index == 4:
            return None
        self.index += 1
        self.ranges[:] = self.pose[0, 3] = self.index
        return Capture(self.index, float(self.index), scan=Scan(np.arange(3.0), self.ranges, 10.0))

    def truth(self):
        return self.pose

    def clearance_m(self):
        return 1.0, False


def test_blame_shows_the_views_of_a_source_that_fills_its_arrays_again_as_they_were():
    watched = Watched(Refilled(), "source=refilled")
    shown = [(watched.lead().scan.ranges_m[0], watched.truth()[0, 3]) for _ in range(4)]
    assert shown == [(1.0, 1.0), (2.0, 2.0), (3.0, 3.0), (4.0, 4.0)]


def test_a_simulator_with_a_world_of_its_own_is_not_judged_by_the_one_that_was_typed():
    world = load_world("square_small")
    assert drives_in(world, world.facts())
    assert not drives_in(world, WorldFacts("flat", (1.0, 1.0, 0.0), (("door", 5.0, 3.0),), (0.0, 0.0, 6.0, 4.0), 0.15))


@dataclass
class Semantic:
    """A sensor with a label for each pixel."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "labels"})

    def build(self, context):
        return self

    def sense(self, capture):
        raise NotImplementedError


@dataclass
class Labelled:
    """An odometry that looks at the labels."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "labels"})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def update(self, observation):
        return Motion(np.eye(4), observation.extras["labels"].mean() * np.eye(6), Tracking.OK)


def test_a_sensor_that_has_the_extra_modality_which_a_part_needs_is_offered():
    rhs.register("sensor", "semantic", Semantic)
    rhs.register("odometry", "labelled", Labelled)
    with pytest.raises(ConfigError, match="needs labels, which source=fake does not provide; type .*sensor=semantic"):
        compose_config([*LIGHT[:2], "odometry=labelled"])


def test_a_check_that_has_not_what_a_part_needs_says_so(capsys):
    rhs.register("odometry", "labelled", Labelled)
    assert check.main(["odometry=labelled"]) == 1
    assert "the views of these checks hold no labels, which it needs" in capsys.readouterr().out
