"""The public face: what a person in a notebook types."""

import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from installing import CHOICE, FAKES, installed

import rhs
from rhs.api.records import Path, PlanReason
from rhs.base.errors import ConfigError, PluginError
from rhs.config import registry
from rhs.patrol.face import config_of

PLANNING = {"task": "planning", "world": "map1"}


@pytest.fixture(autouse=True)
def fakes():
    with installed(FAKES):
        yield
    registry._by_hand.clear()
    registry.forget()


@dataclass
class Direct:
    """Straight to the goal."""

    bend_m: float = 0.0
    """how far the middle of the path stands aside, metres"""
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        import numpy as np

        middle = 0.5 * (problem.start_m + problem.goal_m) + [0.0, self.bend_m]
        points = np.stack([problem.start_m, middle, problem.goal_m])
        return Path(PlanReason.OK, points, points)


def test_every_name_of_the_face_is_there_and_nothing_heavy_is_loaded():
    code = ("import sys, rhs; [getattr(rhs, name) for name in rhs.__all__ if name != 'Config']; "
            "print(sorted({'numpy', 'cv2', 'pandas', 'hydra'} & set(sys.modules)))")
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
    assert {name for name in rhs.__all__ if not hasattr(rhs, name)} == set()


def test_the_loop_yields_every_view_and_leaves_a_run_behind(tmp_path):
    steps = list(rhs.steps([*CHOICE, f"output={tmp_path / 'run'}"]))
    run = rhs.load_run(tmp_path / "run")
    assert [step.index for step in steps] == [int(line["index"]) for line in run.steps]
    assert {step.phase for step in steps} == {"survey", "patrol"} and len(run.table) == len(steps)
    assert run.row["places_visited"] == 2 and run.map.resolution_m == 0.1 and len(run.estimate) == 6


def test_a_loop_that_is_left_early_is_an_interrupted_run(tmp_path):
    for step in rhs.steps([*CHOICE, f"output={tmp_path / 'run'}"]):
        if step.index == 3:
            break
    del step
    import gc

    gc.collect()
    assert rhs.load_run(tmp_path / "run").row["status"] == "interrupted"


def test_who_stops_a_run_stops_the_loop_over_runs(tmp_path):
    """The row was returned, and the next seed began."""
    words = [*CHOICE, "odometry=faulty", "odometry.how=interrupt", "recording=off", "pictures=off"]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    try:
        with pytest.raises(KeyboardInterrupt):
            rhs.run([*(word for word in words if word != "odometry=fake"), f"output={tmp_path / 'run'}"], quiet=True)
    finally:
        signal.signal(signal.SIGINT, before)
    assert rhs.load_run(tmp_path / "run").row["status"] == "interrupted"


def test_steps_of_words_that_mean_nothing_are_refused_at_once():
    with pytest.raises(ConfigError, match="did you mean fake"):
        rhs.steps([*CHOICE, "planner=fak"])


def test_a_trajectory_alone_has_no_figures(tmp_path):
    (tmp_path / "a.tum").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(ConfigError, match="a.tum: expected a run folder, or two trajectories"):
        rhs.evaluate(tmp_path / "a.tum")


def test_what_a_run_left_behind_is_shown_in_a_line(tmp_path):
    rhs.run([*CHOICE, f"output={tmp_path / 'run'}"], quiet=True)
    run = rhs.load_run(tmp_path / "run")
    assert re.fullmatch(r"OccupancyGrid\(\d+ x \d+ cells of 0.1 m from x=\S+ y=\S+, \d+% seen\)", repr(run.map))
    assert re.fullmatch(r"Trajectory\(\d+ poses, [\d.]+ s, [\d.]+ m\)", repr(run.estimate))
    assert "yaw_deg=-0," not in "".join(map(repr, rhs.steps([*CHOICE, f"output={tmp_path / 'again'}"])))


@pytest.fixture
def notebook(monkeypatch):
    """What is shown in a notebook: the names of pictures. Its stderr is no terminal."""
    shown = []
    kernel = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=1))
    display = SimpleNamespace(Image=lambda filename: FilePath(filename).name, display=shown.append)
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return shown


def test_a_notebook_shows_a_bar_and_the_picture_of_the_task(notebook, tmp_path, capsys):
    rhs.run([*CHOICE, f"output={tmp_path / 'run'}"])
    assert "survey" in (err := capsys.readouterr().err) and "view" in err
    rhs.run(PLANNING | {"output": str(tmp_path / "plan")})
    assert notebook == ["overview.png", "plan.png"]
    rhs.run([*CHOICE, f"output={tmp_path / 'quiet'}"], quiet=True)
    assert not capsys.readouterr().err and len(notebook) == 2


def test_a_sweep_in_a_notebook_shows_how_far_it_is(notebook, tmp_path, capsys):
    words = PLANNING | {"seed": [0, 1], "output": str(tmp_path / "sweep")}
    rhs.sweep(words, jobs=1)
    assert re.search(r"2/2 \[.*job", capsys.readouterr().err)
    rhs.sweep(words | {"output": str(tmp_path / "quiet")}, jobs=1, quiet=True)
    assert not capsys.readouterr().err


def test_tab_after_the_dot_shows_the_face_alone():
    assert dir(rhs) == sorted(rhs.__all__)


def test_what_ends_the_loop_is_raised_after_its_row_is_written(tmp_path):
    words = [*(w for w in CHOICE if not w.startswith("odometry")), "odometry=faulty", "odometry.how=raise"]
    with pytest.raises(ValueError, match="fails on purpose"):
        list(rhs.steps([*words, f"output={tmp_path / 'run'}"]))
    row = rhs.load_run(tmp_path / "run").row
    assert row["status"] == "failed"
    assert row["reason"].startswith("odometry=faulty (rhs-fakes 0.1) failed in rhs_fakes/parts.py:")
    assert "fails on purpose" in (tmp_path / "run" / "traceback.txt").read_text()


PLANS_BY_A_FUNCTION = """
from dataclasses import dataclass
from typing import ClassVar

@dataclass
class ByFunction:
    needs: ClassVar[frozenset] = frozenset()
    provides: ClassVar[frozenset] = frozenset()
    def build(it, context):
        return Made()

class Made:
    def plan(this, problem):
        return work(problem)

def work(problem):
    raise ValueError("fails in a plain function")
"""


def test_a_part_is_named_whatever_it_calls_its_self_and_where_it_calls_a_function(tmp_path):
    (tmp_path / "by_function.py").write_text(PLANS_BY_A_FUNCTION)
    words = ["--plugin", str(tmp_path / "by_function.py"), "task=planning", "world=square_small", "planner=by_function"]
    words += [f"output={tmp_path / 'run'}"]
    done = subprocess.run([sys.executable, "-m", "rhs", *words], capture_output=True, text=True)
    line = 1 + PLANS_BY_A_FUNCTION.splitlines().index('    raise ValueError("fails in a plain function")')
    assert f"by_function.py:{line}: ValueError: fails in a plain function" in done.stderr, done.stderr
    assert "planner=by_function" in done.stderr


def test_a_part_may_be_an_object_and_the_row_names_its_file(tmp_path):
    words = dict(word.split("=") for word in CHOICE)
    row = rhs.run({**words, "planner": Direct(bend_m=0.1), "output": str(tmp_path / "run")}, quiet=True)
    assert (row["status"], row["planner"], row["places_visited"]) == ("ok", "direct", 2)
    assert "planner=direct from test_face.py (" in row["plugins"]
    assert "bend_m: 0.1" in (tmp_path / "run" / "config.yaml").read_text()


def test_a_class_whose_cell_was_run_again_is_the_new_one():
    """The name went on to stand for the class of before: an edited part was never run."""
    for step_m in (1.0, 2.0):
        again = dataclass(type("Direct", (Direct,), {"__module__": __name__, "__annotations__": {"reach_m": float},
                                                     "reach_m": step_m, "__qualname__": "Direct"}))
        config = config_of({"task": "planning", "world": "map1", "planner": again()})
        assert type(config.planner.settings) is again and config.planner.settings.reach_m == step_m


def test_an_object_takes_nobody_elses_name():
    own = dataclass(type("Prm", (Direct,), {"__module__": __name__, "__qualname__": "Prm"}))
    config = config_of({"task": "planning", "world": "map1", "planner": own()})
    assert config.planner.name == "prm_2" and type(config.planner.settings) is own
    assert registry.load("planner", "prm").__module__ == "rhs_planners.config"


def test_a_registered_plugin_is_chosen_by_its_word():
    rhs.register("planner", "mine", Direct)
    config = rhs.Config
    assert config.__name__ == "RunConfig"
    from rhs.config.compose import compose_config

    assert compose_config([*CHOICE, "planner=mine", "planner.bend_m=0.3"]).planner.settings.bend_m == 0.3
    with pytest.raises(PluginError, match="no such kind of plugin; did you mean planner"):
        rhs.register("planer", "mine", Direct)
    with pytest.raises(PluginError, match="is not a dataclass"):
        rhs.register("planner", "other", int)


def test_one_text_instead_of_a_list_is_refused():
    with pytest.raises(ConfigError, match="is one text; give a list"):
        rhs.run("seed=3")


@pytest.mark.parametrize(("face", "words", "says"), [
    (rhs.run, None, "expected a list of words"), (rhs.run, [3], "expected a list of words"),
    (rhs.sweep, [3], "expected a list of words"), (rhs.sweep, {"seed": []}, "seed: an empty list"),
    (rhs.run, {"planner": object()}, "planner: found an object of object; expected a name"),
    (rhs.sweep, {"planner": [object()]}, "planner: found an object of object; expected a name")])
def test_what_are_no_words_is_refused_in_one_line(face, words, says):
    with pytest.raises(ConfigError, match=says):
        face(words)


def test_limits_of_a_sweep_have_a_range():
    for limit in ({"jobs": -1}, {"timeout_s": -1.0}):
        with pytest.raises(ConfigError, match="outside the allowed range"):
            rhs.sweep(["task=planning"], **limit)


def test_values_of_numpy_and_odd_folders_are_taken_as_they_are(tmp_path):
    row = rhs.run({**PLANNING, "seed": np.int64(3), "start": np.array([1.0, 2.0]), "output": tmp_path / "run"}, quiet=True)
    assert (row["status"], row["seed"]) == ("ok", 3)
    folder = tmp_path / "with (brackets), a comma and \u00fc"
    table = rhs.sweep({**PLANNING, "seed": np.arange(2), "start": [(1, 2), np.array([2.0, 2.0])], "output": folder}, jobs=1)
    assert sorted(zip(table["seed"], table["start"], strict=True)) == [
        (seed, str(start)) for seed in (0, 1) for start in ([1.0, 2.0], [2.0, 2.0])] and folder.is_dir()


SCRIPT = """
import rhs
from dataclasses import dataclass
from typing import ClassVar

print("begins")

@dataclass
class Own:
    needs: ClassVar[frozenset] = frozenset()
    provides: ClassVar[frozenset] = frozenset()

    def build(self, context):
        raise ValueError("built")

print(*rhs.sweep({"task": "planning", "world": "map1", "planner": PLANNER, "output": FOLDER}, jobs=1)["reason"])
"""


def test_a_script_without_a_guard_may_sweep_and_is_run_once(tmp_path):
    """Jobs do not read it, unless a plugin of theirs stands in it: then its rows say what to write."""
    def said(planner, name):
        script = tmp_path / name
        script.write_text(SCRIPT.replace("PLANNER", planner).replace("FOLDER", repr(str(tmp_path / f"{name}_out"))))
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0 and done.stderr == ""
        return done.stdout

    assert said("'astar'", "others.py") == "begins\n\n"
    told = said("Own()", "own.py")
    assert told.count("begins") == 1 and "put what runs experiments under `if __name__ == '__main__':`" in told


def test_a_class_of_a_notebook_is_refused_before_a_sweep_begins(tmp_path):
    class Local(Direct):
        pass

    with pytest.raises(PluginError, match="write it at the top of a .py file"):
        rhs.sweep({**PLANNING, "planner": Local(), "output": tmp_path / "s"})
    assert not (tmp_path / "s").exists()


def test_a_step_is_printed_in_one_line(tmp_path):
    step = next(rhs.steps([*CHOICE, f"output={tmp_path / 'run'}"]))
    assert repr(step).startswith("Step(index=0, phase='survey', stamp_s=") and len(repr(step)) < 150


def test_records_and_lines_of_steps_are_printed_in_a_line(tmp_path):
    *_, step = rhs.steps([*CHOICE, f"output={tmp_path / 'run'}"])
    assert repr(step.motion).startswith("Motion(previous_from_body=<pose at 0.")
    assert "status=Tracking.OK" in repr(step.motion)
    assert "ranges_m=<(60,) float64>" in repr(step.observation) and "\n" not in repr(step.observation)
    assert "Camera(width=32, height=24, fx=29.4" in repr(step.observation.camera)
    assert repr(rhs.load_run(tmp_path / "run").steps[0]).startswith("StepLine({'index': '0', 'phase': 'survey', 'stamp_s'")


def test_a_sweep_is_a_data_frame(tmp_path):
    table = rhs.sweep({"task": "planning", "world": "map1", "planner": ["astar", "theta_star"], "seed": [0],
                       "output": str(tmp_path / "s")}, jobs=1)
    assert sorted(table["planner"]) == ["astar", "theta_star"] and set(table["plan_valid"]) == {1}
    assert sorted(rhs.table(tmp_path / "s")["planner"]) == ["astar", "theta_star"]


@pytest.mark.parametrize(("call", "says"), [
    (lambda: rhs.sweep(["seed=0,1"], jobs="2", quiet=True), "jobs='2': expected a number, found str"),
    (lambda: rhs.load_run(None), "found None of type NoneType; expected the folder of a run, as a text or a Path"),
    (lambda: rhs.table(b"runs"), "found b'runs' of type bytes; expected a folder of runs"),
    (lambda: rhs.evaluate("a.tum", 3), "found 3 of type int; expected a trajectory"),
    (lambda: rhs.register("planner", 3, int), "planner=3: a plugin's name is letters"),
    (lambda: rhs.register("planner", "mine", lambda: 1), "found an object of function; give the class itself")])
def test_what_is_of_the_wrong_type_is_refused_in_one_line(call, says):
    with pytest.raises(rhs.RhsError, match=says):
        call()
