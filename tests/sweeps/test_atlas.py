"""`python -m rhs atlas`: refused in one line, killed it goes on, a picture and tables of what is known."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from rhs.api.errors import ConfigError
from rhs.base.data_dirs import data_dir
from rhs.cli.main import main
from rhs.metrics.threshold import fit
from rhs.reports.dial_pictures import atlas_picture
from rhs.sweeps import atlas, break_point
from rhs.sweeps.jobs import Limits

TWO = {"rrt": "planner=rrt", "connect": "planner=rrt_connect"}


def written(folder: Path, **changes: object) -> Path:
    content = {"words": ["task=planning", "world=map1"], "runs": 5, "seed": 3, "combinations": TWO,
               "dials": ["planner.iterations=5..5000"]} | changes
    path = folder / "combos.yaml"
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))
    return path


@pytest.mark.parametrize(("changes", "says"), [
    ({"dial": []}, "unknown key dial; did you mean dials"), ({"dials": []}, "2 combinations and 0 dials"),
    ({"combinations": None}, "0 combinations"), ({"runs": "many"}, "runs: found 'many'; expected a int"),
    ({"runs": 2}, "expected 4 to 10000"), ({"dials": ["planner.iterations=9..5"]}, "rrt, planner.iterations=9..5: break"),
    ({"combinations": {"a": "planner=rrt,rrt_connect"}}, "its words are 2 combinations"),
    ({"combinations": {"a": "planner=rrt", "b": "planner=rrt"}}, "are the same"),
    ({"combinations": {"a": {"planner": "rrt"}}}, "a: found {'planner': 'rrt'}; expected words"),
    ({"combinations": {"a": "planner='rrt"}}, "expected words"),
    ({"combinations": {"a": "planner=prm"}}, "iterations"), ({"words": ["seed=1,2"]}, "a seed of its own")])
def test_what_is_no_atlas_is_refused_in_one_line(changes, says, tmp_path):
    with pytest.raises(ConfigError, match=says) as caught:
        atlas.read_atlas(written(tmp_path, **changes))
    assert "\n" not in str(caught.value) and "combos.yaml" in str(caught.value)


def test_words_may_be_a_list_and_quoted_as_in_a_shell(tmp_path):
    both = {"line": "planner=rrt 'planner.iterations=50'", "list": ["planner=rrt", "planner.iterations=60"]}
    found = atlas.read_atlas(written(tmp_path, combinations=both, dials=["planner.goal_bias=0.01..0.9"]))
    assert [name for name, _, _ in found.cells] == ["line", "list"]


def test_the_example_is_one():
    example = atlas.read_atlas(data_dir("conf") / "atlas" / "example.yaml")
    names, dials = {name for name, _, _ in example.cells}, {dial for _, dial, _ in example.cells}
    assert len(example.cells) == len(names) * len(dials) == 8 and example.runs == 24


def test_a_killed_atlas_goes_on_and_adds_what_is_new(tmp_path, capsys):
    """Stopped after three of ten runs, then resumed with another number of processes: every seed once; a finished search
    is not run again when a combination is added."""
    folder = tmp_path / "atlas"
    folder.mkdir()
    told: list[str] = []

    def stopped(name: str, status: str) -> None:
        told.append(name)
        if len(told) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        atlas.run_atlas(atlas.read_atlas(written(tmp_path)), folder, Limits(1), tell=stopped)
    path = written(tmp_path)
    assert main(["atlas", str(path), "--jobs", "2", f"output={folder}"]) == 0
    first = {one["combination"]: one for one in json.loads((folder / "atlas.json").read_text())}
    assert {name: one["runs"] for name, one in first.items()} == {"rrt": 5, "connect": 5}
    rows = [line.row for line in atlas.read_lines(atlas.shards(folder), []).values()]
    assert sorted((row["planner"], row["seed"]) for row in rows) == sorted(
        (name, seed) for name in ("rrt", "rrt_connect") for seed in range(3, 8))
    before = sum(1 for shard in atlas.shards(folder) for _ in shard.open())
    path = written(tmp_path, combinations=TWO | {"biased": "planner=rrt planner.goal_bias=0.5"})
    assert main(["atlas", str(path), "--jobs", "1", f"output={folder}"]) == 0
    assert sum(1 for shard in atlas.shards(folder) for _ in shard.open()) == before + 5
    table = list(csv.DictReader((folder / "atlas.csv").open()))
    assert [(one["combination"], one["runs"]) for one in table] == [("rrt", "5"), ("connect", "5"), ("biased", "5")]
    assert table[0]["middle"] == f"{first['rrt']['middle']:.6g}" and (folder / "atlas.png").stat().st_size > 5000
    assert "rrt" in capsys.readouterr().out


def test_what_is_withstood_is_counted_from_the_harmless_end():
    """Falls above 0.3 of the dial: 0.3 withstood. Falls below 0.3: 0.7. Never falls: all of it."""
    levels = [k / 40 for k in range(41)]
    above, below, never = ([level < 0.3 for level in levels], [level > 0.3 for level in levels], [True] * 41)
    found = [break_point.withstood(fit(levels, outcome).summary()) for outcome in (above, below, never, [False] * 41)]
    assert found == pytest.approx([0.3, 0.7, 1.0, 0.0], abs=0.05)


def test_the_picture_has_a_cell_for_each_pair(tmp_path):
    one = {"found": True, "middle": 5.0, "between": "4 to 6", "direction": 1, "withstood": 0.5, "runs": 9,
           "ends": [0, 9]}
    told = [one | {"combination": name, "dial": dial} for name in "ab" for dial in ("x.y", "z")]
    assert atlas_picture(told, tmp_path / "a.png").read_bytes() == atlas_picture(told, tmp_path / "b.png").read_bytes()
