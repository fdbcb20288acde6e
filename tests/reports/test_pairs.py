"""Pairs of run folders: everything agrees but what is compared, or there is no pair."""

import numpy as np
import pytest
import yaml
from scipy import stats

from rhs.api.errors import ConfigError
from rhs.reports.compare import compare, pairs
from rhs.reports.table import main, rows
from rhs.runfolder.row import write_row


def put(folder, config, **row):
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config | {"output": folder.name, "overwrite": False}))
    names = {name: config[name] for name in ("task", "world", "seed")}
    names |= {kind: part["name"] for kind, part in config.items() if isinstance(part, dict) and "name" in part}
    write_row(folder, {"status": "ok", "reason": "", "config_hash": folder.name, **names, **row})


def plan(folder, planner, scenario, seed=0, **row):
    config = {"task": "planning", "world": "arena2.map.scen", "seed": seed, "planning": {"scenario": scenario},
              "planner": {"name": planner, "own": 1 if planner == "astar" else 2}, "sensor": {"name": "rgbd"}}
    found = {"plan_success": 1, "plan_valid": 1.0, "plan_reason": "ok", "plan_length_m": 10.0, "plan_optimal_m": 10.0}
    put(folder / f"{planner}{scenario}_{seed}", config, **(found | row))


def survey(folder, odometry, width, seed, **row):
    config = {"task": "survey", "world": "square", "seed": seed, "source": {"name": "simulator", "image_width": width},
              "odometry": {"name": odometry, "gate": 2.0 if odometry == "orb" else 4.0}}
    put(folder / f"{odometry}{width}_{seed}", config, tracked_share=1.0, **row)


def test_three_scenarios_are_three_pairs(tmp_path):
    for scenario, slow in ((100, 3.0), (500, 4.0), (900, 5.0)):
        plan(tmp_path, "astar", scenario, plan_ms=1.0)
        plan(tmp_path, "rrt_connect", scenario, plan_ms=slow)
    line = compare(rows([tmp_path]), "planner", ["plan_ms"]).iloc[0]
    assert (line["pairs"], line["with_both"], line["units"]) == (3, 3, 3)
    assert line["p"] == 0.25 == line["least_p"] and line["mean"] == pytest.approx(-3.0)
    assert line["p"] == pytest.approx(stats.wilcoxon([-2.0, -3.0, -4.0]).pvalue)
    wanted = stats.ttest_1samp([-2.0, -3.0, -4.0], 0.0).confidence_interval()
    assert (line["low"], line["high"]) == pytest.approx((wanted.low, wanted.high))


@pytest.fixture(scope="module")
def widths(tmp_path_factory):
    """orb is 10 % better than procrustes at each of three image widths, ten seeds, a scatter of 2 %."""
    folder, rng = tmp_path_factory.mktemp("widths"), np.random.default_rng(0)
    for width in (160, 320, 640):
        for seed in range(10):
            error = 32.0 / width * rng.lognormal(0.0, 0.3)
            survey(folder, "procrustes", width, seed, ate_rmse_m=error)
            survey(folder, "orb", width, seed, ate_rmse_m=0.9 * error * rng.lognormal(0.0, 0.02))
    return folder


def test_a_gain_is_found_across_a_setting_that_was_swept_beside_it(widths):
    table = rows([widths])
    line = compare(table, "odometry", ["ate_rmse_m"]).iloc[0]
    wide = table.pivot(index=["source.image_width", "seed"], columns="odometry", values="ate_rmse_m")
    assert line["pairs"] == line["units"] == 30 and line["high"] < 0.0
    assert line["p"] == pytest.approx(stats.wilcoxon(wide["orb"], wide["procrustes"]).pvalue) and line["p"] < 1e-8


def test_a_setting_is_compared_like_a_part(widths):
    view = compare(rows([widths]), "source.image_width", ["ate_rmse_m"]).set_index("difference")
    assert list(view.index) == ["160 - 320", "160 - 640", "320 - 640"]
    assert (view["pairs"] == 20).all() and (view["low"] > 0.0).all()  # ten seeds by two odometries


def test_runs_that_differ_in_more_are_no_pairs(tmp_path):
    survey(tmp_path, "orb", 320, 0, ate_rmse_m=0.1)
    survey(tmp_path, "procrustes", 640, 0, ate_rmse_m=0.2)
    with pytest.raises(ConfigError, match=r"differ in source.image_width too"):
        compare(rows([tmp_path]), "odometry", ["ate_rmse_m"])


def test_the_task_is_not_compared_unasked(tmp_path):
    survey(tmp_path / "a", "orb", 320, 0, ate_rmse_m=0.1)
    survey(tmp_path / "b", "procrustes", 320, 0, ate_rmse_m=0.2)
    path = tmp_path / "b" / "procrustes320_0"
    (path / "config.yaml").write_text((path / "config.yaml").read_text().replace("task: survey", "task: patrol"))
    write_row(path, {"status": "ok", "task": "patrol", "world": "square", "odometry": "procrustes", "source": "simulator",
                     "seed": 0, "ate_rmse_m": 0.2})
    with pytest.raises(ConfigError, match="differ in task too"):
        compare(rows([tmp_path]), "odometry", ["ate_rmse_m"])


def test_a_pair_that_is_not_unique_is_refused_by_name(tmp_path, capsys):
    plan(tmp_path, "astar", 100)
    plan(tmp_path / "a", "prm", 100)
    plan(tmp_path / "b", "prm", 100)
    config = tmp_path / "b" / "prm100_0" / "config.yaml"
    config.write_text(config.read_text().replace("own: 2", "own: 7"))
    assert main([str(tmp_path), "--compare", "planner", "--columns", "plan_length_m"]) == 2
    said = capsys.readouterr().err
    assert "planner.own" in said and len(said.splitlines()) == 1
    found, alone = pairs(rows([tmp_path]), "planner.own")  # of the two prm runs; astar has another planner
    assert [pair.name for pair in found] == ["2 - 7"] and alone == 1


def test_the_same_run_twice_is_refused(tmp_path):
    for place in ("one", "two"):
        plan(tmp_path / place, "astar", 100)
        plan(tmp_path / place, "prm", 100)
    with pytest.raises(ConfigError, match="same run twice"):
        compare(rows([tmp_path]), "planner", ["plan_length_m"])


def test_an_invalid_path_is_a_failure_in_every_figure_of_a_comparison(tmp_path):
    """The cheat goes through walls: shorter, but never a solution."""
    for scenario in range(6):
        plan(tmp_path, "astar", scenario, plan_length_m=10.0 + scenario)
        plan(tmp_path, "cheat", scenario, plan_length_m=1.0, plan_valid=0.0)
    line = compare(rows([tmp_path]), "planner", ["plan_length_m"]).iloc[0]
    assert (line["pairs"], line["with_both"], line["both_solved"]) == (6, 0, 0) and np.isnan(line["mean"])
    assert (line["only_first_complete"], line["only_second_complete"]) == (6, 0)
    assert line["p_complete"] == pytest.approx(2 * 0.5**6)


def test_the_difference_over_what_both_solved_stands_beside_the_scores(tmp_path):
    """b fails the two long problems: its mean is shorter, and it is longer wherever both arrive."""
    for scenario, length in ((0, 10.0), (1, 12.0), (2, 14.0), (3, 90.0), (4, 95.0)):
        found = length < 50.0
        plan(tmp_path, "a", scenario, plan_length_m=length, plan_optimal_m=length, plan_ms=1.0)
        plan(tmp_path, "b", scenario, plan_optimal_m=length, plan_length_m=length + 1.0 if found else None, plan_ms=2.0,
             plan_success=int(found), plan_valid=1.0 if found else None, plan_reason="ok" if found else "budget_spent")
    table = rows([tmp_path])
    means = table.groupby("planner")["plan_length_m"].mean()
    assert means["b"] < means["a"]
    view = compare(table, "planner", ["plan_length_m", "spl", "par2_ms"]).set_index("column")
    assert view.loc["plan_length_m", "both_solved"] == 3 and view.loc["plan_length_m", "mean_both_solved"].startswith("-1")
    spl_b = (10 / 11 + 12 / 13 + 14 / 15) / 5
    assert view.loc["spl", "mean"] == pytest.approx(1.0 - spl_b) and view.loc["spl", "with_both"] == 5
    assert view.loc["par2_ms", "mean"] == pytest.approx((3 * (1 - 2) + 2 * (1 - 2 * 2)) / 5)


def test_two_planners_without_randomness_are_one_pair_a_problem(tmp_path):
    for seed in range(30):
        plan(tmp_path, "astar", 100, seed, plan_length_m=10.0)
        plan(tmp_path, "theta_star", 100, seed, plan_length_m=9.0)
    view = compare(rows([tmp_path]), "planner", ["plan_length_m"])
    assert (view.loc[0, "pairs"], view.loc[0, "units"], view.loc[0, "p"]) == (30, 1, 1.0) and np.isnan(view.loc[0, "low"])
    assert any("too few to reach" in note for note in view.attrs["notes"])


def test_worlds_with_several_seeds_are_the_units(tmp_path):
    rng = np.random.default_rng(1)
    for world in "abcd":
        for seed in range(5):
            for planner, extra in (("astar", 0.0), ("prm", 1.0)):
                folder = tmp_path / f"{world}{planner}{seed}"
                folder.mkdir()
                write_row(folder, {"status": "ok", "world": world, "planner": planner, "seed": seed, "places_total": 1,
                                   "places_visited": 1, "ate_rmse_m": 1.0 + extra + 0.1 * rng.normal()})
    table = rows([tmp_path])
    line = compare(table, "planner", ["ate_rmse_m"]).iloc[0]
    assert (line["pairs"], line["units"], line["p"]) == (20, 4, 0.125)
    alone = compare(table, "planner", ["ate_rmse_m"], cluster="run").iloc[0]
    assert (alone["units"], alone["p"]) == (20, pytest.approx(2.0**-19))


def test_what_a_reader_must_know_is_printed(tmp_path, capsys):
    for seed in range(3):
        plan(tmp_path, "a", 100, seed, plan_length_m=10.0 + seed)
        plan(tmp_path, "b", 100, seed, plan_length_m=20.0 - seed)
        plan(tmp_path, "c", 100, seed, plan_length_m=30.0 + seed)
    plan(tmp_path, "c", 100, 3)
    assert main([str(tmp_path), "--compare", "planner", "--columns", "plan_length_m,plan_optimal_m"]) == 0
    said = capsys.readouterr().out
    assert "corrected for 6 comparisons (Holm)" in said and "too few to reach p < 0.05: 6 of 6" in said
    assert "1 runs have no partner" in said


def test_default_columns_of_a_comparison_hold_the_scores(tmp_path, capsys):
    for scenario in range(3):
        plan(tmp_path, "a", scenario, plan_ms=1.0)
        plan(tmp_path, "b", scenario, plan_ms=2.0)
    assert main([str(tmp_path), "--compare", "planner"]) == 0
    said = capsys.readouterr().out
    assert "spl" in said and "par2_ms" in said


def test_a_setting_that_is_unset_is_compared_with_one_that_is(tmp_path):
    """`null` beside a number: they were said to differ in nothing."""
    for seed in range(3):
        for limit, ate in ((None, 0.2), (2.0, 0.1)):
            config = {"task": "survey", "world": "square", "seed": seed, "odometry": {"name": "theirs", "limit": limit}}
            put(tmp_path / f"{limit}_{seed}", config, tracked_share=1.0, ate_rmse_m=ate + 0.01 * seed)
    line = compare(rows([tmp_path]), "odometry.limit", ["ate_rmse_m"]).iloc[0]
    assert (line["difference"], line["pairs"]) == ("null - 2.0", 3) and line["mean"] == pytest.approx(0.1)
