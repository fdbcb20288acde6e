"""The public face: what a person in a notebook types."""

from dataclasses import dataclass
from typing import ClassVar

import pytest
from installing import CHOICE, FAKES, installed

import rhs
from rhs.api.records import Path, PlanReason
from rhs.base.errors import ConfigError, PluginError
from rhs.config import registry


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
    import subprocess
    import sys

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


def test_what_ends_the_loop_is_raised_after_its_row_is_written(tmp_path):
    words = [*(w for w in CHOICE if not w.startswith("odometry")), "odometry=faulty", "odometry.how=raise"]
    with pytest.raises(ValueError, match="fails on purpose"):
        list(rhs.steps([*words, f"output={tmp_path / 'run'}"]))
    row = rhs.load_run(tmp_path / "run").row
    assert row["status"] == "failed"
    assert row["reason"].startswith("odometry=faulty (rhs-fakes 0.1) failed in rhs_fakes/parts.py:")
    assert "fails on purpose" in (tmp_path / "run" / "traceback.txt").read_text()


def test_a_part_may_be_an_object_and_the_row_names_its_file(tmp_path):
    words = dict(word.split("=") for word in CHOICE)
    row = rhs.run({**words, "planner": Direct(bend_m=0.1), "output": str(tmp_path / "run")}, quiet=True)
    assert (row["status"], row["planner"], row["places_visited"]) == ("ok", "direct", 2)
    assert "planner=direct from test_face.py (" in row["plugins"]
    assert "bend_m: 0.1" in (tmp_path / "run" / "config.yaml").read_text()


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


def test_a_sweep_is_a_data_frame(tmp_path):
    table = rhs.sweep({"task": "planning", "world": "map1", "planner": ["astar", "theta_star"], "seed": [0],
                       "output": str(tmp_path / "s")}, jobs=1)
    assert sorted(table["planner"]) == ["astar", "theta_star"] and set(table["plan_valid"]) == {1}
    assert sorted(rhs.table(tmp_path / "s")["planner"]) == ["astar", "theta_star"]
