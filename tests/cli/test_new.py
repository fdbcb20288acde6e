"""`python -m rhs new`: what it makes runs and keeps its contract."""

import sys

import pytest

from rhs.cli.main import main
from rhs.cli.new import SKELETONS
from rhs.config import registry


@pytest.fixture(autouse=True)
def afresh():
    yield
    registry._by_hand.clear()
    registry.forget()


@pytest.mark.parametrize("kind", SKELETONS)
def test_a_new_plugin_keeps_its_contract(kind, tmp_path, capsys):
    assert main(["new", kind, f"my_{kind}", str(tmp_path / "package")]) == 0
    file = tmp_path / "package" / f"my_{kind}" / "__init__.py"
    assert main(["check", "--plugin", str(file), f"{kind}=my_{kind}"]) == 0, capsys.readouterr().out
    assert "keeps its contract" in capsys.readouterr().out


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
    (["tabel", "run"], "did you mean table?"), (["new", "planer", "x"], "say a kind"),
    (["new", "planner", "No!"], "small letters")])
def test_a_command_typed_wrong_is_one_line(words, says, capsys):
    assert main(words) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1
