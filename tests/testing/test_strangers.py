"""What people who know only the README bring: taken where it is honest, named in one line where it is a first draft."""

from __future__ import annotations

import enum
import os
import signal
import time
from dataclasses import dataclass, field, replace
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import ClassVar, Literal, NamedTuple

import numpy as np
import pytest
from planted import odometry, settings

import rhs
from rhs.api import settings as plain
from rhs.api.contracts import complete
from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import inverse, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.metric import Metric
from rhs.api.records import Belief, Path, PlanReason
from rhs.api.validate import check_path
from rhs.base.processes import raises
from rhs.card import card
from rhs.config import loose, registry
from rhs.config.compose import compose_config
from rhs.metrics.evaluate import evaluate
from rhs.patrol.face import config_of
from rhs.runfolder.row import sound
from rhs.sweeps.face import _words
from rhs.testing import check_plugin
from rhs.testing.planners import empty, problem
from rhs.testing.room import CAMERA

pytestmark = pytest.mark.usefixtures("afresh")


class Pair(NamedTuple):
    x: float


class Heuristic(enum.Enum):
    OCTILE = "octile"
    ZERO = "zero"


@dataclass
class Costs:
    """What steps cost."""

    turn: float = 0.0
    """of a turn"""


@dataclass
class Straight:
    """Goes straight; its settings are of every type that people use."""

    heuristic: Heuristic = Heuristic.OCTILE
    """lower bound"""
    costs: Costs = field(default_factory=Costs)
    log_file: FilePath | None = None
    """where it writes"""
    folder: FilePath = FilePath("debug")
    """where it writes more"""
    weights: list = field(default_factory=lambda: [1.0])
    """numbers"""
    reach_m: float = 5.0
    """metres"""
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        return Path(PlanReason.OK, [list(problem.start_m), list(problem.goal_m)])


def test_settings_of_every_type_are_typed_and_kept():
    typed = {"heuristic": "ZERO", "costs": {"turn": 2}, "log_file": "a.csv", "folder": "b", "weights": [1, 2]}
    made = plain.make(Straight, typed, "planner")
    assert made == Straight(Heuristic.ZERO, Costs(2.0), FilePath("a.csv"), FilePath("b"), [1, 2])
    assert plain.make(Straight, plain.plain(made), "planner") == made
    assert plain.plain(made)["heuristic"] == "zero" and plain.type_name(Heuristic) == "octile | zero"


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_a_setting_that_is_not_finite_is_refused_for_everybody(wrong):
    with pytest.raises(ConfigError, match="planner.costs.turn=.*expected a finite number"):
        plain.make(Straight, {"costs": {"turn": wrong}}, "planner")


@pytest.mark.parametrize(("hint", "default", "says"), [
    (np.ndarray, 1.0, "setting odd of type ndarray cannot"), ("Nowhere", 1.0, "cannot be looked up: name 'Nowhere'"),
    (float, None, "setting odd has no default value"), (float, "fast", "default of setting odd does not fit.*odd=fast"),
    (np.float64, np.float64(1.0), "odd of type float64 cannot"), (Pair, Pair(1.0), "setting odd of type Pair cannot")])
def test_a_setting_that_nobody_can_type_is_named(hint, default, says):
    body = {"__annotations__": {"odd": hint}, "build": Straight.build, "needs": frozenset(), "provides": frozenset()}
    odd = dataclass(type("Odd", (), body | ({} if default is None else {"odd": default})))
    with pytest.raises(ConfigError, match=says):
        rhs.register("planner", "odd", odd)


@pytest.mark.parametrize(("kind", "name", "says"), [
    ("planner", "defaults", "setting defaults has a name that rhs uses itself"), ("planner", "länge", "länge cannot"),
    ("task", "experiment", "called experiment, which rhs uses"), ("task", "hydra", "called hydra, which rhs uses")])
def test_a_setting_whose_name_leads_elsewhere_is_refused(kind, name, says):
    """Seen: `Invalid defaults list`, `its file must begin with the line`."""
    body = {"__annotations__": {name: float}, name: 1.0, "build": Straight.build, "needs": frozenset(),
            "provides": frozenset(), "kinds": ()}
    with pytest.raises(ConfigError, match=says):
        rhs.register(kind, "odd", dataclass(type("Odd", (), body)))


def test_true_is_not_1_and_a_key_may_be_of_an_enumeration():
    @dataclass
    class Odd:
        choice: Literal[1, 2, "auto"] = "auto"
        prices: dict[Heuristic, float] = field(default_factory=dict)

    Odd.__annotations__ = {"choice": Literal[1, 2, "auto"], "prices": dict[Heuristic, float]}
    with pytest.raises(ConfigError, match="planner.choice=true: expected 1 | 2 | auto"):
        plain.make(Odd, {"choice": True}, "planner")
    made = plain.make(Odd, {"choice": 1, "prices": {"ZERO": 2}}, "planner")
    assert made.prices == {Heuristic.ZERO: 2.0} and plain.make(Odd, plain.plain(made), "planner") == made


@pytest.mark.parametrize(("kinds", "says"), [
    ({}, "declares no kinds"), ({"kinds": "planner"}, "declares no kinds; write .*planner"),
    ({"kinds": ("planer",)}, "there is no kind planer; did you mean planner")])
def test_the_kinds_of_a_task_are_a_tuple_of_kinds(kinds, says):
    """A text in their place, `("planner")`, was said to hold no kind called a."""
    body = {"build": Straight.build, "needs": frozenset(), "provides": frozenset()}
    with pytest.raises(ConfigError, match=says):
        rhs.register("task", "odd", dataclass(type("Odd", (), body | kinds)))


@pytest.mark.parametrize("preload", ["scipy", (3,), None])
def test_modules_to_load_once_are_a_tuple_of_names(preload):
    """Seen: `TypeError: '<' not supported between instances of 'str' and 'int'`."""
    with pytest.raises(ConfigError, match="preload is .*; expected a tuple of modules"):
        rhs.register("planner", "odd", dataclass(type("Odd", (Straight,), {"preload": preload})))


def test_a_build_without_context_is_refused():
    with pytest.raises(ConfigError, match=r"has no build\(self, context\)"):
        rhs.register("planner", "odd", dataclass(type("Odd", (Straight,), {"build": lambda self: self})))


@pytest.mark.parametrize(("kind", "part", "says"), [
    ("planner", SimpleNamespace(compute=print), "has no plan(problem)"), ("planner", None, "has no plan(problem)"),
    ("planner", SimpleNamespace(plan=lambda grid, start, goal: None), "plan cannot be called as plan(problem)"),
    ("source", SimpleNamespace(lead=lambda: None, camera=1), "has no facts"),
    ("localiser", SimpleNamespace(learn=lambda views, grid: 0, update=lambda o, m: 0), "has no start(belief)"),
    ("engine", SimpleNamespace(open=lambda: None), "has no width"), ("slam", odometry.NoBase(None), "has no belief()")])
def test_a_missing_method_or_one_with_other_arguments_is_named(kind, part, says):
    with pytest.raises(ContractError) as caught:
        complete(kind, part)
    assert says in str(caught.value)


def test_a_method_that_yields_or_is_async_is_refused_before_it_does_nothing():
    """Seen: a mapper whose update holds a yield was never run, and the map stayed empty."""
    class Lazy:
        def update(self, map_from_body, scan):
            yield scan

        async def grid(self):
            return None

        def reset(self):
            return None

    with pytest.raises(ContractError, match="Lazy.update yields or is async"):
        complete("mapper", Lazy())
    Lazy.update = lambda self, map_from_body, scan: None
    with pytest.raises(ContractError, match="Lazy.grid yields or is async"):
        complete("mapper", Lazy())


@pytest.mark.parametrize(("kind", "said", "says"), [
    ("odometry", {"keeps_moving": "far"}, "keeps_moving is 'far'; expected tuple[float, float] | None"),
    ("odometry", {"short_steps": (0.1, 0.0)}, "short_steps is (0.1, 0.0); expected"),
    ("odometry", {"scale_from": 5}, "scale_from is 5; expected str"),
    ("source", {"views_expected": "many"}, "views_expected is 'many'; expected int | None"),
    ("source", {"provides": "scan"}, "provides is 'scan'; expected frozenset[str] | None"),
    ("source", {"timed": "no"}, "timed is 'no'; expected bool"),
    ("engine", {"chunk_s": float("nan")}, "chunk_s is nan; expected float")])
def test_what_a_part_says_of_itself_is_of_its_type(kind, said, says):
    """Seen: keeps_moving="far" ended a run after its survey with `too many values to unpack`, naming nobody."""
    there = {"source": {"camera": 1, "facts": 2, "lead": lambda: None}, "odometry": {"update": lambda observation: None},
             "engine": {"width": 1, "open": lambda: None}}
    with pytest.raises(ContractError) as caught:
        complete(kind, SimpleNamespace(**there[kind], **said))
    assert says in str(caught.value)


def test_a_source_that_only_leads_is_given_the_rest():
    source = complete("source", SimpleNamespace(camera=1, facts=2, lead=lambda: None))
    assert source.truth() is None and np.isnan(source.clearance_m()[0]) and source.close() is None


TASK = problem(empty())
START, GOAL = TASK.start_m, TASK.goal_m
CELLS = (np.array([START, GOAL]) - TASK.origin_m) / TASK.resolution_m


def test_lists_and_float32_are_paths():
    assert check_path(Path(PlanReason.DISCONNECTED, []), TASK, who="x").points_m.shape == (0, 2)
    points = np.array([START, 0.5 * (START + GOAL), GOAL], np.float32)
    kept = check_path(Path(PlanReason.OK, points), TASK, who="x").points_m
    assert np.array_equal(kept[[0, -1]], [START, GOAL]) and not np.array_equal(points[0], START)


@pytest.mark.parametrize(("points", "says"), [
    ([GOAL, START], "the path is reversed"), ([START[::-1], GOAL[::-1]], "x and y are exchanged"),
    (np.floor(CELLS), "these (column, row) are cells"), (np.floor(CELLS[:, ::-1]), "these (row, column) are cells"),
    ([START - TASK.origin_m, GOAL - TASK.origin_m], "origin_m is missing"),
    ([START + 0.04, GOAL], "put start_m before"), ([START, [4.5, 0.1], GOAL], "between its ends x and y are exchanged")])
def test_a_path_that_is_refused_says_which_mistake_it_would_fit_without(points, says):
    with pytest.raises(ContractError) as caught:
        check_path(Path(PlanReason.OK, np.array(points)), TASK, who="x")
    assert says in str(caught.value)


class Camera(odometry.Honest):
    says = "it were the body's, not the camera's"

    def motion(self, observation):
        said = super().motion(observation)
        camera = CAMERA.body_from_camera
        return replace(said, previous_from_body=inverse(camera) @ said.previous_from_body @ camera)


class Summed(odometry.Honest):
    says = "it were not summed up"
    pose = np.eye(4)

    def motion(self, observation):
        said = super().motion(observation)
        self.pose = self.pose @ said.previous_from_body
        return replace(said, previous_from_body=self.pose)


class Degrees(odometry.Honest):
    says = "its angle, in degrees, were in radians"

    def travel(self, wheel):
        return [*wheel[:2], np.degrees(wheel[2])]


@pytest.mark.parametrize("part", [Camera, Summed, Degrees])
def test_motions_in_another_frame_or_unit_are_told_so(part):
    with pytest.raises(AssertionError) as caught:
        check_plugin("odometry", settings(part, "wheel"))
    assert part.says in str(caught.value)


def test_a_word_of_needs_that_is_nearly_one_is_asked_about():
    with pytest.raises(AssertionError, match="needs names 'whel'; did you mean wheel"):
        check_plugin("odometry", settings(odometry.Honest, "whel"))


class Slam(odometry.Honest):
    """Counts the wheels, and believes in an empty room."""

    def __init__(self, context):
        super().__init__(context)
        self.poses = [se2(*context.world.start)]

    def update(self, observation):
        motion = super().update(observation)
        self.poses += [self.poses[-1] @ motion.previous_from_body] if self.views > 1 else []
        return motion

    def belief(self):
        return Belief(self.poses[-1], 1e-4 * np.eye(6))

    def trajectory(self):
        return np.stack(self.poses)

    def grid(self):
        return OccupancyGrid(np.full((40, 60), 0.05), 0.1, (0.0, 0.0))


def test_a_slam_is_checked():
    check_plugin("slam", settings(Slam, "wheel"))
    short = type("Short", (Slam,), {"trajectory": lambda self: np.stack(self.poses)[1:]})
    with pytest.raises(AssertionError, match=r"trajectory\(\)"):
        check_plugin("slam", settings(short, "wheel"))


def test_a_check_that_never_ends_is_ended_and_named(monkeypatch):
    monkeypatch.setattr(card, "CHECK_PATIENCE_S", 0.5)
    hangs = type("Hangs", (odometry.Honest,), {"update": lambda self, observation: time.sleep(60)})
    told = card.contract("odometry", settings(hangs, "wheel"))
    assert [one["why"] for one in told[3:5]] == ["no answer for 0.5 s", "not reached"]


def test_a_signal_ends_the_processes_of_a_part_as_any_other():
    before = signal.signal(signal.SIGTERM, raises(KeyboardInterrupt))
    try:
        if (child := os.fork()) == 0:
            os._exit(0 if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL else 1)
        assert os.waitpid(child, 0)[1] == 0
    finally:
        signal.signal(signal.SIGTERM, before)


def test_what_a_planner_raises_in_build_is_not_blamed_on_the_task(tmp_path):
    @dataclass
    class Careless(Straight):
        def build(self, context):
            raise ValueError("forgot something")

    row = rhs.run({"task": "planning", "world": "map1", "planner": Careless(), "output": str(tmp_path / "run")}, quiet=True)
    assert row["reason"].startswith("planner=careless (test_strangers.py") and "forgot something" in row["reason"]


def test_objects_in_a_sweep_are_words():
    words = list(_words("planner", Straight(Heuristic.ZERO, Costs(2.0), reach_m=3.0)))
    assert words == ["planner=straight", "planner.heuristic='zero'", "planner.costs.turn=2.0", "planner.reach_m=3.0"]
    assert list(_words("planner", [Straight(), "astar"])) == ["planner=straight,astar"]
    pair = [Straight(reach_m=1.0), Straight(Heuristic.ZERO)]
    assert list(_words("planner", pair)) == [
        "zip(planner=straight,straight planner.reach_m=1.0,5.0 planner.heuristic='octile','zero')"]
    with pytest.raises(ConfigError, match="objects in a list are of one class"):
        list(_words("planner", [Straight(reach_m=1.0), "astar"]))


@pytest.mark.parametrize("name", ["", " a", "a,b", "a\nb"])
def test_what_is_no_name_of_a_column_is_told(name):
    assert sound({name: 1, "good": 2}) == {"good": 2, "row_failures": sound({name: 1})["row_failures"]}
    assert "no name of a column" in sound({name: 1})["row_failures"]


def test_one_metric_is_registered_as_several_are(tmp_path):
    rhs.register("metric", "alone", Metric("alone_m", "m", "one", "nothing", lambda run: 7.0, tasks=()))
    assert evaluate(tmp_path)["alone_m"] == 7.0


def test_a_metric_takes_no_column_that_there_is(tmp_path):
    forged, mine = (Metric(name, "m", "x", "mine", lambda run: 2.0, tasks=()) for name in ("status", "mine_m"))
    registry.register("metric", "taken", (forged, mine))
    values = evaluate(tmp_path, "planning")
    assert values["mine_m"] == 2.0 and "status" not in values
    assert "status of mine: there is a column" in values["metric_failures"]


def test_a_plugin_in_another_group_is_pointed_at():
    with pytest.raises(ConfigError, match="has it in the entry point group rhs.planner"):
        registry.load("odometry", "prm")


def test_a_plugin_of_a_file_is_found_by_whatever_names_it(tmp_path):
    """A run folder that is blamed or verified names it, and no word on the command line does."""
    (tmp_path / "mine.py").write_text(f"from {__name__} import Straight\n\n\nclass OfAFile(Straight):\n    pass\n".replace(
        "class", "from dataclasses import dataclass\n\n\n@dataclass\nclass"))
    loose.load_files([str(tmp_path / "mine.py")], [])
    assert registry.load("planner", "of_a_file").__name__ == "OfAFile"
    registry._by_hand.clear()
    registry.forget()
    with pytest.raises(ConfigError, match="add --plugin FILE.py"):
        registry.load("planner", "of_a_file")


@dataclass
class Tables(Straight):
    """Straight on, with prices by name."""

    prices: dict[str, float] = field(default_factory=lambda: {"turn": 1.0})
    """of each thing"""
    names: dict[str, int] | None = None
    """of others"""


@pytest.mark.parametrize(("words", "prices", "names"), [
    (["planner.prices.stop=2"], {"turn": 1.0, "stop": 2.0}, None),
    (["planner.prices={stop:2,turn:3}"], {"turn": 3.0, "stop": 2.0}, None),
    (["planner.names={a:1}"], {"turn": 1.0}, {"a": 1}),
])
def test_a_setting_that_is_a_dict_takes_any_key(words, prices, names):
    rhs.register("planner", "tables", Tables)
    made = compose_config(["planner=tables", *words]).planner.settings
    assert made.prices == prices and made.names == names


@pytest.mark.parametrize(("word", "says"), [
    ("planner.prices.stop=many", "planner.prices.stop=many: expected float"),
    ("planner.prices={a:{b:1}}", "planner.prices.a={'b': 1}: expected float"),
    ("planner.costs.stop=1", "unknown key planner.costs.stop; there is turn"),
    ("planner.reach_m.x=1", "planner.reach_m is a single value"),
])
def test_what_is_no_key_of_a_dict_is_refused(word, says):
    rhs.register("planner", "tables", Tables)
    with pytest.raises(ConfigError, match=says.replace("{", "\\{")):
        compose_config(["planner=tables", word])


@dataclass
class Inner:
    share: float = 0.5
    """of a whole"""


@dataclass
class Kept(Tables):
    """A dataclass that may be left out, keys that are numbers, lists of numbers."""

    inner: Inner | None = None
    """more of it"""
    floors: dict[int, float] = field(default_factory=dict)
    """heights by number, metres"""
    weights: list[float] = field(default_factory=list)
    """of each"""


@pytest.mark.parametrize(("word", "name", "value"), [
    ("planner.inner.share=0.25", "inner", Inner(0.25)), ("planner.inner={share:0.25}", "inner", Inner(0.25)),
    ("planner.inner=null", "inner", None), ("planner.floors={2:3.5}", "floors", {2: 3.5}),
    ("planner.floors.2=3.5", "floors", {2: 3.5})])
def test_a_dataclass_that_may_be_left_out_and_keys_that_are_numbers_are_typed(word, name, value):
    rhs.register("planner", "kept", Kept)
    assert getattr(compose_config(["planner=kept", word]).planner.settings, name) == value


@pytest.mark.parametrize(("word", "says"), [
    ("planner.weights=[1,nan]", "expected finite numbers"), ("planner.prices={turn:inf}", "expected finite numbers"),
    ("planner.floors.cellar=3", "the key 'cellar': expected int"), ("planner.inner.shore=1", "expected Inner | null")])
def test_what_is_inside_lists_and_dicts_is_checked_too(word, says):
    rhs.register("planner", "kept", Kept)
    with pytest.raises(ConfigError, match=says.replace("|", "[|]")):
        compose_config(["planner=kept", word])


def test_an_object_is_built_as_it_is_or_refused():
    """Its dict was merged with its class's default."""
    whole = Kept(prices={"turn": 2.0, "stop": 1.0}, floors={2: 3.5}, inner=Inner(0.25))
    assert config_of({"planner": whole}).planner.settings == whole
    assert "planner.floors.2=3.5" in list(_words("planner", whole))
    for take in (lambda less: config_of({"planner": less}), lambda less: list(_words("planner", less))):
        with pytest.raises(ConfigError, match="planner.prices lacks the key turn of its class's default"):
            take(Kept(prices={"stop": 1.0}))


@pytest.mark.parametrize(("word", "says"), [
    ("straght", "has no Straght; did you mean planner=straight?"),
    ("no_data", "NoData in .* is no plugin; write @dataclass"),
    ("else", "holds Straight, Tables; write rhs.register")])
def test_a_name_that_no_class_of_a_file_has_is_asked_about(tmp_path, word, says):
    made = "@dataclass\nclass {0}(T.{0}):\n    pass\n\n\n"
    (tmp_path / "mine.py").write_text(f"from dataclasses import dataclass\n\nimport {__name__} as T\n\n\n" + "".join(
        map(made.format, ("Straight", "Tables"))) + "class NoData:\n    def build(self, context):\n        pass\n")
    with pytest.raises(ConfigError, match=says):
        loose.load_files([str(tmp_path / "mine.py")], [f"planner={word}"])


class Misspelt(Straight):
    """Asks for a reason that there is not."""

    def plan(self, problem):
        return Path(PlanReason.SUCCESS, [])


class Silent(Straight):
    """Returns nothing."""

    def plan(self, problem):
        return None


def test_what_a_part_raised_is_told_with_its_own_line_and_what_it_returned_without_advice():
    with pytest.raises(AssertionError, match=r"AttributeError: PlanReason has no SUCCESS; .*\(test_strangers.py:\d+\)"):
        check_plugin("planner", Misspelt())
    with pytest.raises(AssertionError, match="is of type NoneType; expected a Path$"):
        check_plugin("planner", Silent())
