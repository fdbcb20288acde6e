"""`python -m rhs break`: refused before anything runs, and a search that ends with its files."""

import json
from dataclasses import dataclass
from typing import ClassVar

import pytest

import rhs
from rhs.base.errors import ConfigError
from rhs.cli.main import main
from rhs.config import registry
from rhs.metrics.threshold import Dial
from rhs.runfolder.row import read_row
from rhs.sweeps.break_point import Search, account, dial_of, learn, plan
from rhs.sweeps.sensitivity import ask

PLANNING = ["task=planning", "world=map1"]


@pytest.mark.parametrize(("words", "says"), [
    (["planner=rrt"], "found 0 dials"), (["planner.iterations=9..1", "planner=rrt"], "the lower first"),
    (["planner.iterations=1..9", "planner.goal_bias=0..1"], "found 2 dials"),
    (["planner.iterations=1..9", "planner=rrt", "seed=1,2"], "a seed of its own"),
    (["planner.goal_bias=0..7", "planner=rrt"], "goal_bias"),
    (["planner.iteration=0..7", "planner=rrt"], "did you mean planner.iterations"),
    (["world=1..9"], "no numeric setting")])
def test_what_is_no_dial_is_refused(words, says):
    with pytest.raises(ConfigError, match=says):
        plan([*PLANNING, *words])


@dataclass
class Odd:
    """A planner that takes odd numbers."""

    kernel: int = 3
    """cells"""
    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self):
        if self.kernel % 2 == 0:
            raise ConfigError(f"kernel={self.kernel}: expected an odd number")

    def build(self, context):
        return self


def test_a_value_that_is_refused_within_the_dial_is_refused_before_anything_runs():
    rhs.register("planner", "odd", Odd)
    with pytest.raises(ConfigError, match="planner.kernel=4: expected an odd number; a dial takes every value between"):
        plan([*PLANNING, "planner=odd", "planner.kernel=3..7"])
    with pytest.raises(ConfigError, match="nothing to try: planner.kernel .*expected an odd number"):
        ask(["planner=odd"])
    registry._by_hand.clear()
    registry.forget()


def test_a_dial_is_one_word_with_two_ends():
    dial, rest = dial_of(["a.b=1e-3..2.5", "seed=3"])
    assert (dial.key, dial.low, dial.high, dial.logarithmic, rest) == ("a.b", 0.001, 2.5, True, ["seed=3"])


def test_a_search_tries_both_combinations_with_the_same_seeds(tmp_path, capsys):
    words = ["break", *PLANNING, "planner.iterations=5..5000", "planner=rrt,rrt_connect", "--runs", "6", "--jobs", "2",
             "seed=10", f"output={tmp_path / 'break'}"]
    assert main(words) == 0
    told = json.loads((tmp_path / "break" / "break.json").read_text())
    assert [one["combination"] for one in told] == ["planner=rrt", "planner=rrt_connect"]
    assert all(one["runs"] == len(one["tried"]) == 6 and one["direction"] == -1 for one in told)
    rows = [read_row(path) for path in (tmp_path / "break").glob("*/row.json")]
    seeds = {name: sorted(row["seed"] for row in rows if row["planner"] == name) for name in ("rrt", "rrt_connect")}
    assert seeds["rrt"] == seeds["rrt_connect"] == list(range(10, 16))
    assert (tmp_path / "break" / "break.png").stat().st_size > 5000
    assert capsys.readouterr().out.count("planner.iterations:") == 2


def test_a_degradation_is_chosen_by_its_dial_whether_it_takes_whole_numbers_or_not():
    assert plan(["degrade.delay_views=0..8", "world=square_small"]).dial.whole
    assert not plan(["degrade.slip_share=0..0.8", "world=square_small"]).dial.whole


def test_where_nothing_succeeds_the_reason_is_told():
    """A part that raises in every run has no break point."""
    search, dial = Search("mine", []), Dial("a.b", 0.0, 1.0)
    for level in (0.0, 0.5, 1.0, 0.25):
        learn(search, level, {"status": "failed", "success": 0.0, "reason": "odometry=mine failed in my.py:3"}, "here")
    assert account(search, dial)["says"].endswith(": odometry=mine failed in my.py:3")
    learn(search, 0.1, {"status": "ok", "success": 1.0}, "here")
    assert "my.py" not in account(search, dial)["says"]


def test_runs_that_were_refused_are_told_apart_from_those_that_failed():
    """A dial that a world cannot turn ends where it begins, and no part is to blame."""
    search, dial = Search("mine", []), Dial("moved_count", 0.0, 4.0, whole=True)
    refused = {"status": "refused", "success": 0.0, "reason": "moved_count=2: square_small has none"}
    for level, row in ((0.0, {"status": "ok", "success": 1.0}), (0.5, refused), (1.0, refused)):
        learn(search, level, row, "here")
    assert account(search, dial)["says"].endswith(": 2 of 3 were refused, not driven, all at 2 and more, where "
                                                  "the dial ends, 1 of 1 others succeeded: moved_count=2: square_small "
                                                  "has none")
    learn(search, 0.75, {"status": "ok", "success": 1.0}, "")  # one that was driven among them
    assert "not driven: moved_count" in account(search, dial)["says"]
