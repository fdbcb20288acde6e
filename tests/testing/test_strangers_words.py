"""What is said of a stranger's part where Python itself says next to nothing, and of what only a run shows."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import pytest

from rhs.api.records import BeliefStatus
from rhs.base.errors import words_of
from rhs.cli.say import of_drawn
from rhs.config import registry
from rhs.config.compose import compose_config
from rhs.config.loose import load_files
from rhs.config.overrides import parse, plain_words, sweep_words
from rhs.patrol.run import run_config, run_steps
from rhs.testing import check_plugin

PLANNER = '''"""Draws from numpy's own generator, and leaves the building."""
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.records import Path, PlanReason


@dataclass
class Careless:
    """Leaves the building."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        np.random.normal()
        return Path(PlanReason.OK, np.vstack([problem.start_m, [0.0, 99.0], problem.goal_m]))
'''


def test_a_name_that_an_enumeration_lacks_is_told_with_those_that_it_has():
    with pytest.raises(AttributeError) as caught:
        BeliefStatus.OK  # noqa: B018 - what is tested
    assert words_of(caught.value) == "BeliefStatus has no OK; it has TRACKING, DEGRADED, CONVERGING, LOST"
    assert words_of(ValueError("so")) == "so"


@dataclass
class Asserts:
    """Believes that there is always a way."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        raise AssertionError


def test_an_assert_without_words_is_told_with_its_line():
    with pytest.raises(AssertionError, match=r"AssertionError: \(test_strangers_words.py:\d+\)"):
        check_plugin("planner", Asserts())


def test_a_run_says_that_a_global_generator_was_used_and_how_a_part_is_asked(tmp_path):
    (tmp_path / "mine.py").write_text(PLANNER, encoding="utf-8")
    words = ("--plugin", "mine.py", "task=planning", "world=square_small", "planner=careless")
    said = subprocess.run([sys.executable, "-m", "rhs", *words], cwd=tmp_path, capture_output=True, text=True, timeout=180,
                          check=False)
    assert said.returncode == 3, said.stderr
    assert "numpy's global generator was used: the same seed may not give this row again" in said.stderr
    assert "does your part keep its contract? python -m rhs check [--plugin FILE] KIND=NAME" in said.stderr
    ours = subprocess.run([sys.executable, "-m", "rhs", *words[2:4], "planner=rrt"], cwd=tmp_path, capture_output=True,
                          text=True, timeout=180, check=False)
    assert ours.returncode == 0 and "generator" not in ours.stderr


@pytest.mark.parametrize(("word", "value"), [
    ("output=Läufe 2", "Läufe 2"), ("world=/a/Straße.yaml", "/a/Straße.yaml"), ("output='Läufe'", "Läufe"),
    ("mission={x:ü}", {"x": "ü"})])
def test_letters_that_are_not_english_need_no_quotes(word, value):
    assert [one.value for one in plain_words(parse([word]))] == [value]


def test_the_name_of_a_part_may_have_letters_that_are_not_english(tmp_path, monkeypatch):
    """An entry point may; Hydra's grammar answered LexerNoViableAltException."""
    about = tmp_path / "odd-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: odd\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[rhs.planner]\nfür_flure = odd_planner:Careless\n", encoding="utf-8")
    (tmp_path / "odd_planner.py").write_text(PLANNER, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    registry.forget()
    try:
        assert compose_config(["task=planning", "world=map1", "planner=für_flure"]).parts["planner"].name == "für_flure"
    finally:
        sys.modules.pop("odd_planner", None)
        registry.forget()


def test_each_value_of_a_sweep_may_have_letters_that_are_not_english():
    found = sweep_words(parse(["world=Häuser/a.yaml,b.yaml"]), most=10)
    assert [words[0].value for words in found] == ["Häuser/a.yaml", "b.yaml"]


def test_the_row_of_a_run_says_so_too_and_a_sweep_in_how_many(tmp_path):
    """Rows travel from the processes of a sweep; rhs.steps, whose caller may draw, says nothing."""
    (tmp_path / "mine.py").write_text(PLANNER, encoding="utf-8")
    load_files([tmp_path / "mine.py"], ["planner=careless"])
    try:
        config = compose_config(["task=planning", "world=square_small", "planner=careless"])
        assert run_config(config, tmp_path)["global_random"] == "numpy"
        (tmp_path / "other").mkdir()
        steps = run_steps(config, tmp_path / "other")
        with pytest.raises(StopIteration) as end:
            next(steps)
        assert "global_random" not in end.value.value
    finally:
        registry._by_hand.clear()
        registry.forget()
    assert of_drawn(["numpy", None, "numpy and Python"])[0].startswith("2 of 3 runs used the global generator of numpy or ")
    assert of_drawn([None, float("nan")]) == []
