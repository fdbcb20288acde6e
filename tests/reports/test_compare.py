"""Paired comparisons."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.reports.compare import compare, holm
from rhs.reports.summary import summarise
from rhs.reports.table import main, rows
from rhs.runfolder.row import write_row


@pytest.fixture
def folder(tmp_path):
    """Worlds differ far more than planners: b is 0.1 m longer than a in each, c is like a but fails half the time."""
    rng = np.random.default_rng(0)
    for seed in range(12):
        world_m = rng.uniform(10, 100)
        for planner, extra in (("a", 0.0), ("b", 0.1), ("c", 0.0)):
            fails = planner == "c" and seed % 2
            (tmp_path / f"{planner}{seed}").mkdir()
            write_row(tmp_path / f"{planner}{seed}", {
                "status": "ok", "world": "w", "planner": planner, "seed": seed, "places_total": 2,
                "places_visited": 1 if fails else 2,
                "path_length_m": None if fails else world_m + extra + rng.normal(0, 0.01)})
    return tmp_path


def test_pairing_sees_what_averages_hide(folder):
    table = rows([folder])
    view = compare(table, "planner", ["path_length_m"]).set_index("difference")
    ab = view.loc["a - b"]
    assert ab["mean"] == pytest.approx(-0.1, abs=0.01) and ab["low"] < -0.09 < ab["high"] + 0.02 and ab["high"] < 0
    assert ab["p"] < 0.01 and ab["pairs"] == 12
    lengths = table.groupby("planner")["path_length_m"]
    assert lengths.std()["a"] > 50 * abs(lengths.mean()["a"] - lengths.mean()["b"])


def test_intervals_of_several_comparisons_say_that_each_stands_alone(folder):
    three = compare(rows([folder]), "planner", ["path_length_m"])
    one = compare(rows([folder]).query("planner != 'c'"), "planner", ["path_length_m"])
    assert "95 % of each of the 3 comparisons alone, not corrected" in " ".join(three.attrs["notes"])
    assert "alone" not in " ".join(one.attrs["notes"])


def test_failures_are_counted_and_not_dropped(folder):
    view = compare(rows([folder]), "planner", ["path_length_m"]).set_index("difference")
    ac = view.loc["a - c"]
    assert (ac["pairs"], ac["with_both"], ac["only_first_complete"], ac["only_second_complete"]) == (12, 6, 6, 0)
    assert ac["p_complete"] == pytest.approx(3 * (2 * 0.5**6))  # 6 of 6 one way; three comparisons


def test_a_run_that_broke_off_has_no_errors_of_the_way_and_is_counted_as_failed(tmp_path):
    """Part b raises at the third view of every other seed: what it believed until then is no accuracy."""
    for seed in range(6):
        for name, ate_m in (("a", 0.2), ("b", 0.001 if seed % 2 else 0.3)):
            broke = name == "b" and seed % 2
            (tmp_path / f"{name}{seed}").mkdir()
            write_row(tmp_path / f"{name}{seed}", {
                "status": "failed" if broke else "ok", "reason": "x" if broke else "", "world": "w", "odometry": name,
                "seed": seed, "success": 0.0 if broke else 1.0, "ate_rmse_m": ate_m + 1e-4 * seed, "places_visited": 2})
    table = rows([tmp_path])
    view = compare(table, "odometry", ["ate_rmse_m"]).iloc[0]
    assert (view["pairs"], view["with_both"], view["only_first_complete"]) == (6, 3, 3)
    assert view["mean"] == pytest.approx(-0.1, abs=0.001)
    told = summarise(table, group=["odometry"], columns=["ate_rmse_m"]).set_index("odometry").loc["b"]
    assert told["failed"] == 3 and told["ate_rmse_m"].startswith("0.3")


def test_holm_by_hand():
    # sorted 0.01 0.02 0.03 times 3, 2, 1, never falling
    np.testing.assert_allclose(holm(np.array([0.03, 0.01, np.nan, 0.02])), [0.04, 0.03, np.nan, 0.04])


def test_nothing_to_pair(folder):
    with pytest.raises(ConfigError, match="same worlds and seeds"):
        compare(rows([folder]), "odometry", ["path_length_m"])


def test_the_command(folder, capsys):
    assert main([str(folder), "--compare", "planner", "--columns", "path_length_m"]) == 0
    assert "a - b" in capsys.readouterr().out
    assert main([str(folder), "--compare", "plannr"]) == 2
