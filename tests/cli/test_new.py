"""`python -m rhs new`: what it makes runs and keeps its contract."""

import re
import sys
from pathlib import Path

import pytest

from rhs.api.contracts import PLUGIN_KINDS, PROTOCOLS
from rhs.cli.main import main
from rhs.config import registry

CHECKED = [kind for kind in PROTOCOLS if kind != "engine"]  # by rhs.testing; the others are run
SMALL = "world=square_small"
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def afresh():
    yield
    registry._by_hand.clear()
    registry.forget()


@pytest.mark.parametrize("kind", CHECKED)
def test_a_new_plugin_keeps_its_contract(kind, tmp_path, capsys):
    assert main(["new", kind, f"my_{kind}", str(tmp_path / "package")]) == 0
    file = tmp_path / "package" / f"my_{kind}" / "__init__.py"
    assert main(["check", "--plugin", str(file), f"{kind}=my_{kind}"]) == 0, capsys.readouterr().out
    assert "keeps its contract" in capsys.readouterr().out


@pytest.mark.parametrize(("kind", "words", "column"), [
    ("task", ["task=my_task", SMALL, "odometry=wheel", "most_views=5"], "way_m"),
    ("metric", ["task=survey", SMALL, "odometry=wheel", "loop_closer=none"], "longest_step_m")])
def test_a_new_column_is_in_what_is_printed(kind, words, column, tmp_path, capsys):
    """What a stranger's task or metric says is not left to be looked for in row.json."""
    main(["new", kind, f"my_{kind}", str(tmp_path / "package")])
    file = tmp_path / "package" / f"my_{kind}" / "__init__.py"
    assert main(["--plugin", str(file), *words, f"output={tmp_path / 'run'}", "recording=off", "pictures=off"]) == 0
    printed = capsys.readouterr().out
    assert any(line.split()[:1] == [column] and float(line.split()[1]) > 0.0 for line in printed.splitlines()), printed


def test_a_new_engine_runs_a_sweep(tmp_path, capsys):
    main(["new", "engine", "my_engine", str(tmp_path / "package")])
    file = tmp_path / "package" / "my_engine" / "__init__.py"
    words = ["engine=my_engine", "task=planning", SMALL, "planner=astar", "seed=0,1", f"output={tmp_path / 'sweep'}"]
    assert main(["-m", "--plugin", str(file), *words]) == 0
    assert "2 jobs: 2 ok" in capsys.readouterr().out


def test_the_folder_may_be_said_as_everywhere_else(tmp_path):
    assert main(["new", "planner", "mine", f"output={tmp_path / 'package'}"]) == 0
    assert (tmp_path / "package" / "mine" / "__init__.py").exists()


def test_what_is_typed_next_is_printed_for_every_kind(tmp_path, capsys):
    for kind in PLUGIN_KINDS:
        assert main(["new", kind, f"a_{kind}", str(tmp_path / kind)]) == 0
        told = capsys.readouterr().out
        assert "try it:" in told and "keep it:" in told and ("check it:" in told) == (kind in CHECKED)


def test_the_guide_of_a_planner_of_ones_own_goes_as_it_says(tmp_path, capsys):
    """Eight neighbours cut corners, which `check` says in the words of plugins/README.md; its second line mends it."""
    guide = (ROOT / "plugins" / "README.md").read_text("utf-8").partition("## A planner of your own")[2]
    lines = re.findall(r"^```python\n(.*?\n)```", guide, re.M | re.S)
    assert len(lines) == 2
    main(["new", "planner", "my_planner", str(tmp_path / "package")])
    file = tmp_path / "package" / "my_planner" / "__init__.py"
    for line, status in zip(lines, (1, 0), strict=True):
        text, beginning = file.read_text("utf-8"), " ".join(line.split()[:2])
        old = [given for given in text.splitlines(keepends=True) if given.strip().startswith(beginning)]
        file.write_text(text.replace(old[-1], line), "utf-8")
        registry._by_hand.clear()
        capsys.readouterr()
        assert main(["check", "--plugin", str(file), "planner=my_planner"]) == status
        said = capsys.readouterr().out
        assert all(row.split(" s  ")[1] in guide for row in said.splitlines() if "FAILS" in row and "as before" not in row)


def test_its_planner_finds_a_way_and_its_own_test_passes(tmp_path, monkeypatch, capsys):
    main(["new", "planner", "my_planner", str(tmp_path / "package")])
    monkeypatch.syspath_prepend(tmp_path / "package")
    file = tmp_path / "package" / "my_planner" / "__init__.py"
    words = ["task=planning", "world=square_small", "planner=my_planner", f"output={tmp_path / 'run'}"]
    assert main([f"--plugin={file}", *words]) == 0
    test = (tmp_path / "package" / "test_my_planner.py").read_text()
    scope: dict = {}
    exec(test, scope)
    scope["test_it_keeps_its_contract"]()
    sys.modules.pop("my_planner", None)


@pytest.mark.parametrize(("words", "says"), [
    (["tabel", "run"], "did you mean table?"), (["new", "planer", "x"], "did you mean planner?"),
    (["new", "planner", "No!"], "small letters"), (["new", "planner", "class"], "no word of Python"),
    (["help", "columns", "success"], "one word at a time; type python -m rhs help success")])
def test_a_command_typed_wrong_is_one_line(words, says, capsys):
    assert main(words) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1
