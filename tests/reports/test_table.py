"""Row files and the table made of them."""

import csv
import io
import json
import math
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from rhs.api.errors import ConfigError, RhsError
from rhs.reports.summary import summarise
from rhs.reports.table import NUMBER, _typed, main, rows, to_csv
from rhs.runfolder.row import canonical_hash, read_row, write_row

NASTY = ["NA", "", "a,b", 'say "hi"', "two\nlines", "=cmd|' /C calc'!A0", "+1", "-x", "@sum", "12", "1e5", "nan",
         "true", "'quoted", "\tindent", "äöü 机"]


def from_csv(text: str) -> pd.DataFrame:
    """The table that `to_csv` wrote, without its index."""
    reader = csv.reader(io.StringIO(text, newline=""))
    names = [str(_value(cell)) for cell in next(reader)]
    found = {str(number): {name: _value(cell) for name, cell in zip(names, row, strict=True)}
             for number, row in enumerate(reader)}
    data = {name: _typed(name, [row[name] for row in found.values()]) for name in names}
    return pd.DataFrame(data, columns=names)


def _value(cell: str) -> object:
    if cell == "":
        return None
    if cell.startswith("'"):
        return cell[1:]
    if cell in ("true", "false"):
        return cell == "true"
    if not NUMBER.fullmatch(cell):
        return cell
    return int(cell) if re.fullmatch(r"[+-]?\d+", cell) else float(cell)


def run(folder, name, **values):
    (folder / name).mkdir(parents=True)
    row = {"status": "ok", "reason": "", "world": "square", "planner": "prm", "seed": 0, "places_total": 4,
           "places_visited": 4, "ate_rmse_m": 0.1}
    write_row(folder / name, row | values)


def test_a_row_reads_back(tmp_path):
    row = {"status": "ok", "seed": 3, "ate_rmse_m": 0.1 + 0.2, "end_error_m": math.nan, "clearance_min_m": math.inf,
           "flag": True, "count": np.int64(4), "note": None}
    write_row(tmp_path, row)
    read = read_row(tmp_path / "row.json")
    assert read == row | {"end_error_m": None}
    json.loads((tmp_path / "row.json").read_text(), parse_constant=pytest.fail)  # strict JSON: no NaN, no Infinity


def test_a_table_reads_back_equal_in_values_and_types(tmp_path):
    for i, word in enumerate(NASTY):
        run(tmp_path, f"{i:02d}", reason=word, seed=i, extra=None if i % 2 else i, weight=math.inf if i else 1e-300,
            yes=bool(i % 2))
    table = rows([tmp_path])
    again = from_csv(to_csv(table))
    assert list(table["reason"]) == NASTY
    assert again["reason"].isna().tolist() == [word == "" for word in NASTY]  # empty text is an empty cell
    again["reason"] = again["reason"].fillna("")
    pd.testing.assert_frame_equal(again, table.reset_index(drop=True))
    assert str(table["extra"].dtype) == "Int64" and str(table["yes"].dtype) == "boolean"


def test_empty_text_is_an_empty_cell(tmp_path):
    run(tmp_path, "a", reason="")
    header, line = to_csv(rows([tmp_path])).splitlines()
    assert line.split(",")[header.split(",").index("reason")] == "" and "'" not in line


def test_no_cell_starts_a_formula(tmp_path):
    import csv
    import io

    for i, word in enumerate(NASTY):
        run(tmp_path, f"{i:02d}", reason=word, seed=i)
    for line in list(csv.reader(io.StringIO(to_csv(rows([tmp_path])), newline="")))[1:]:
        assert not line[1].startswith(("=", "+", "-", "@", "\t", "\r"))


def test_types_do_not_depend_on_the_runs(tmp_path):
    run(tmp_path / "a", "0", ate_rmse_m=1, collisions=None)
    run(tmp_path / "b", "0", ate_rmse_m=None, collisions=2)
    assert rows([tmp_path / "a"]).dtypes.to_dict() == rows([tmp_path / "b"]).dtypes.to_dict()


def test_order_of_folders_and_names_does_not_matter(tmp_path):
    for place, order in (("a", (0, 1, 2, 10)), ("b", (10, 2, 1, 0))):
        for number, seed in enumerate(order):
            run(tmp_path / place, f"job{number}", seed=seed, wall_ms=float(number))
    one, two = (to_csv(rows([tmp_path / place]), canonical=True) for place in "ab")
    assert one == two and "wall_ms" not in one
    assert list(rows([tmp_path / "a"])["seed"]) == [0, 1, 2, 10]  # as numbers, not as words


def test_what_an_interrupted_writer_left_is_passed_over(tmp_path):
    run(tmp_path, "good")
    run(tmp_path, "0.tmp-123")
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "row.json.tmp-99").write_text('{"status": "o')
    assert len(rows([tmp_path])) == 1


def test_a_damaged_row_is_reported_and_not_counted(tmp_path, capsys):
    run(tmp_path, "good")
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "row.json").write_text('{"status": "o')
    with pytest.raises(RhsError, match="bad"):
        rows([tmp_path])
    assert main([str(tmp_path)]) == 3
    captured = capsys.readouterr()
    assert "bad/row.json" in captured.err and len(captured.err.splitlines()) == 1


def test_the_hash_sees_results_and_not_times():
    row = {"status": "ok", "ate_rmse_m": 0.1, "odometry_ms": 3.0, "peak_memory_mb": 5.0, "real_time_factor": 1.0}
    assert canonical_hash(row) == canonical_hash(row | {"odometry_ms": 4.0, "peak_memory_mb": 6.0})
    assert canonical_hash(row) != canonical_hash(row | {"ate_rmse_m": 0.1 + 1e-16})
    assert canonical_hash(row) == canonical_hash(dict(reversed(row.items())))
    assert canonical_hash({"a": math.nan}) == canonical_hash({"a": None})


def test_a_disk_that_is_full_leaves_the_old_row(tmp_path):
    write_row(tmp_path, {"status": "ok"})
    before = (tmp_path / "row.json").read_bytes()
    code = ("import resource, signal, sys, pathlib; signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
            "from rhs.runfolder.row import write_row; from rhs.api.errors import RhsError\n"
            "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
            "try: write_row(pathlib.Path(sys.argv[1]), {'reason': 'x' * 5000})\n"
            "except RhsError as error: sys.exit(str(error))\n")
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and "cannot write" in done.stderr and "MB free" in done.stderr
    assert (tmp_path / "row.json").read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_the_summary_counts_failures(tmp_path):
    for seed in range(4):
        run(tmp_path, f"prm{seed}", seed=seed, ate_rmse_m=0.1 * seed)
        run(tmp_path, f"rrt{seed}", seed=seed, planner="rrt", status="failed" if seed else "ok", places_visited=3)
    view = summarise(rows([tmp_path])).set_index("planner")
    assert view.loc["prm", "failed"] == 0 and view.loc["rrt", "failed"] == 4  # three ended early, one saw 3 of 4 places
    assert view.loc["prm", "complete"].startswith("1.00") and view.loc["rrt", "complete"].startswith("0.00")
    assert view.loc["prm", "ate_rmse_m"].startswith("0.15 [")


def test_a_column_that_is_not_there(tmp_path):
    run(tmp_path, "a")
    with pytest.raises(ConfigError, match="did you mean ate_rmse_m"):
        summarise(rows([tmp_path]), columns=["ate_rmse"])


def test_the_command(tmp_path, capsys):
    run(tmp_path, "a")
    assert main([str(tmp_path), "--csv", str(tmp_path / "t.csv"), "--group", "world,planner"]) == 0
    assert "square" in capsys.readouterr().out
    again = from_csv((tmp_path / "t.csv").read_text()).assign(reason=pd.array([""], dtype="string"))
    pd.testing.assert_frame_equal(again, rows([tmp_path]).reset_index(drop=True))
    assert main([str(tmp_path / "nothing")]) == 2
    (tmp_path / "empty").mkdir()
    assert main([str(tmp_path / "empty")]) == 2
    assert "python -m rhs" in capsys.readouterr().err


def test_a_survey_is_complete_without_the_places_it_was_not_sent_to(tmp_path):
    run(tmp_path, "a", task="survey", places_visited=0, tracked_share=0.9)
    run(tmp_path, "b", task="patrol", places_visited=0, seed=1)
    run(tmp_path, "c", task="patrol", places_visited=4, seed=2)
    table = summarise(rows([tmp_path]), group=["task"])
    assert table.set_index("task")["complete"].astype(str).str[:4].to_dict() == {"survey": "1.00", "patrol": "0.50"}


def test_settings_group_the_runs_only_where_they_differ_with_the_same_parts(tmp_path):
    for seed in range(2):
        run(tmp_path, f"a{seed}", seed=seed, planner="prm", **{"planner.step_m": 0.2})
        run(tmp_path, f"b{seed}", seed=seed, planner="rrt", **{"planner.step_m": 0.5})
    assert list(summarise(rows([tmp_path])).columns[:2]) == ["planner", "runs"]  # the default of each
    run(tmp_path, "c", seed=0, planner="rrt", **{"planner.step_m": 0.1})
    assert list(summarise(rows([tmp_path])).columns[:3]) == ["planner", "planner.step_m", "runs"]


def test_whatever_was_chosen_by_name_has_a_line_of_its_own(tmp_path):
    for kind, names in {"replan": ("go_round", "wait"), "degrade": (None, "blur"), "slam": (None, "mine"),
                        "task": ("survey", "patrol")}.items():
        folder = tmp_path / kind
        for name in names:
            for seed in (0, 1):
                run(folder, f"{name}_{seed}", seed=seed, **({} if name is None else {kind: name}))
        view = summarise(rows([folder]))
        assert list(view["runs"]) == [2, 2] and view[kind].nunique(dropna=False) == 2


def test_a_sweep_of_blame_says_which_links_were_named_and_how_often(tmp_path):
    """And parts of one plugin under two names are two lines."""
    links, words = ("odometry", "odometry", "localise", ""), ("loop_closer=monocular", "loop_closer=monocular")
    for seed, link in enumerate(links):
        presets = {"presets": words[seed]} if seed < 2 else {}
        run(tmp_path, str(seed), seed=seed, blame_link=link, task="blame", loop_closer="pose_graph", **presets)
    assert list(summarise(rows([tmp_path]), group=["planner"])["blame_link"]) == ["odometry 2, localise 1"]
    view = summarise(rows([tmp_path]))
    assert sorted(view["presets"].fillna("")) == ["", "loop_closer=monocular"]
    assert sorted(view["blame_link"]) == ["localise 1", "odometry 2"]


def test_a_sweep_of_blame_shows_what_each_link_cost_with_its_interval(tmp_path):
    """Means 1.5 and 0.5 of two runs each; errors of ways, which other sweeps show, are left out."""
    for seed, cost in enumerate((1.0, 2.0, 1.0, 2.0)):
        run(tmp_path, str(seed), seed=seed, blame_link="map", task="blame", blame_places_map=cost, ate_rmse_m=0.1,
            blame_places_rest=0.5)
    view = summarise(rows([tmp_path]))
    assert "ate_rmse_m" not in view
    assert view["blame_places_map"][0].startswith("1.5 [0.58") and view["blame_places_rest"][0].startswith("0.5")


def test_a_sweep_of_localisers_shows_whether_they_find_themselves_and_know(tmp_path):
    for name, found in (("mine", 0.5), ("particle_filter_scan", 1.0)):
        run(tmp_path, name, seed=0, task="localise", localiser=name, found_share=found, belief_wrong_sure_share=0.25)
    view = summarise(rows([tmp_path]))
    assert list(view["found_share"]) == ["0.5", "1"] and list(view["belief_wrong_sure_share"]) == ["0.25", "0.25"]


@pytest.mark.parametrize(("words", "says"), [
    (["table", "--comapre", "planner"], "unknown option --comapre; did you mean --compare?"),
    (["compare", "--frmat"], "compare: found --frmat; say what and where"),
    (["gate", "--measur"], "unknown option --measur; did you mean --measure?"),
    (["cache", "--clear"], "cache: unknown option --clear")])
def test_a_mistyped_option_is_named_before_what_is_missing(words, says, capsys):
    from rhs.cli.main import main as rhs

    assert rhs(words) == 2
    assert says in capsys.readouterr().err


def test_a_folder_whose_rows_are_none_is_refused_by_every_command(tmp_path, capsys):
    from rhs.cli.main import main as rhs

    (tmp_path / "row.json").write_text("{}")
    for words in (["table"], ["report"], ["verify"], ["gate", "planner=prm"]):
        assert rhs([words[0], str(tmp_path), *words[1:]]) == 2, words
        assert "row.json cannot be read as a row: it has no status" in capsys.readouterr().err
