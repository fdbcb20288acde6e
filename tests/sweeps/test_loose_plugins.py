"""Plugins registered by hand go with the jobs of a sweep, with its folder, and with what runs it again."""

import importlib.util
import json
import re
import sys

import pytest
from installing import FAKES, installed

import rhs
from rhs.base.errors import PluginError
from rhs.cli.main import main
from rhs.config import loose, registry
from rhs.config.loose import carried, take_over
from rhs.runfolder.row import read_row
from rhs.sweeps.kept import ended
from rhs.sweeps.sweep import plan

SOURCE = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.records import Path, PlanReason


@dataclass
class Direct:
    """Straight to the goal."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self

    def plan(self, problem):
        return Path(PlanReason.OK, np.stack([problem.start_m, problem.goal_m]))
'''
SWEEP = ["task=planning", "world=square_small", "planner=direct,astar"]


@pytest.fixture(autouse=True)
def afresh():
    yield
    _forget()


def _forget():
    loose._silent.clear()
    registry._by_hand.clear()
    registry.forget()


@pytest.fixture
def file(tmp_path):
    (tmp_path / "direct.py").write_text(SOURCE)
    return tmp_path / "direct.py"


def test_a_sweep_its_resume_and_its_verification_know_the_file(file, tmp_path, capsys):
    folder = tmp_path / "sweep"
    assert main(["-m", "--plugin", str(file), *SWEEP, f"output={folder}", "--jobs", "2"]) == 0
    (told,) = json.loads((folder / "sweep.json").read_text())["plugins"]
    assert told.startswith("planner=direct from direct.py (")
    _forget()
    capsys.readouterr()
    assert main(["--debug", "--resume", str(folder), "seed=0,1"]) == 2  # no file of data makes it run another
    assert "add --plugin FILE" in capsys.readouterr().err
    assert main(["--resume", str(folder), "seed=0,1", "--plugin", str(file)]) == 0
    rows = [read_row(path) for path in folder.glob("*/row.json")]
    assert sorted((row["planner"], row["seed"], row["success"]) for row in rows) == [
        (name, seed, 1.0) for name in ("astar", "direct") for seed in (0, 1)]
    _forget()
    capsys.readouterr()
    assert main(["verify", str(folder)]) == 2
    assert "add --plugin FILE" in capsys.readouterr().err
    assert main(["verify", str(folder), "--plugin", str(file)]) == 0


def test_rows_of_other_code_are_not_those_of_the_part_as_it_is_now(file, tmp_path, capsys):
    """A part that was edited had the rows of the old one, in sweeps that go on and in what begins again by itself."""
    words, folder = ["-m", "--plugin", str(file), *SWEEP], tmp_path / "sweep"
    assert main([*words, f"output={folder}", "--jobs", "1"]) == 0
    (job,) = [job for job in plan([*SWEEP, f"output={folder}"]).jobs if job.config.planner.name == "direct"]
    assert ended(job, folder, None)["status"] == "ok"
    _forget()
    file.write_text(SOURCE.replace("Straight", "Straighter"))
    capsys.readouterr()
    assert main([*words, f"output={folder}", "--resume"]) == 2
    told = capsys.readouterr().err
    assert "planner=direct was direct.py (" in told and "take another folder, or type --force" in told
    assert ended(job, folder, None) is None
    assert main([*words, f"output={folder}", "--resume", "--force"]) == 0


def test_two_files_of_one_name_are_two(tmp_path):
    """The second took the place of the first: its row named the other's code, and a sweep ran the other's class."""
    for folder, name in (("a", "Direct"), ("b", "Other")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text(SOURCE.replace("Direct", name))
    files = [str(tmp_path / folder / "mine.py") for folder in ("a", "b")]
    loose.load_files(files, ["planner=direct,other"])
    told = registry.sources("planning", {"planner": "direct"}) + registry.sources("planning", {"planner": "other"})
    assert len({text.partition(" from ")[2] for text in told}) == 2
    sent = carried([("planner", "direct"), ("planner", "other")])
    _forget()
    take_over(sent)
    assert [registry.load("planner", name).__name__ for name in ("direct", "other")] == ["Direct", "Other"]


def test_a_file_takes_no_library_away(tmp_path):
    import json as before

    (tmp_path / "json.py").write_text(SOURCE)
    loose.load_files([str(tmp_path / "json.py")], ["planner=direct"])
    assert sys.modules["json"] is before and registry.load("planner", "direct").__name__ == "Direct"


@pytest.mark.parametrize("more", ["", "import rhs\nrhs.register('planner', 'direct', Direct)\n"])
def test_one_name_in_two_files_is_refused(tmp_path, more):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text(SOURCE + more)
    first = str(tmp_path / "a/mine.py")
    with pytest.raises(PluginError, match="planner=direct: .*a/mine.py and .*b/mine.py both .*rename"):
        loose.load_files([first, str(tmp_path / "b/mine.py")], ["planner=direct"])
    _forget()
    loose.load_files([first, first], ["planner=direct"])


def test_the_code_of_a_package_is_told_in_the_row(tmp_path):
    with installed(FAKES):
        registry.forget()
        (told,) = registry.sources("planning", {"planner": "fake", "odometry": "keyframe"})
        assert re.fullmatch(r"planner=fake from rhs-fakes 0.1 \([0-9a-f]{12}\)", told)


def test_a_registered_class_goes_with_a_sweep_from_python(file, tmp_path):
    spec = importlib.util.spec_from_file_location("direct", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules["direct"] = module
    spec.loader.exec_module(module)
    rhs.register("planner", "direct", module.Direct)
    table = rhs.sweep([*SWEEP, f"output={tmp_path / 'sweep'}"])
    assert set(table["success"]) == {1.0}
    sys.modules.pop("direct")


def test_a_class_that_stands_in_no_file_is_refused_in_the_job_with_what_to_do(file):
    rhs.register("planner", "local", _local())
    sent = carried([("planner", "local")])
    registry._by_hand.clear()
    with pytest.raises(PluginError, match="write it at the top of a .py file"):
        take_over(sent)


def _local():
    scope: dict = {"__name__": "nowhere"}
    exec(SOURCE, scope)
    scope["Direct"].__qualname__ = "_local.<locals>.Direct"
    return scope["Direct"]


@pytest.mark.parametrize("ends", ["raise SystemExit(3)", "raise ValueError"])
def test_a_module_to_preload_that_fails_costs_no_job(ends, tmp_path, monkeypatch):
    """The process that jobs are forked from lives on, and the rows are there. Seen: an EOFError, and a sweep without end."""
    (tmp_path / "fails_when_loaded.py").write_text(f"{ends}\n")
    asks = '    preload: ClassVar = ("fails_when_loaded",)\n    needs:'
    (tmp_path / "direct.py").write_text(SOURCE.replace("    needs:", asks))
    monkeypatch.syspath_prepend(str(tmp_path))
    words = ["--plugin", str(tmp_path / "direct.py"), "-m", *SWEEP, f"output={tmp_path / 's'}"]
    assert main(words) == 0
    assert [read_row(path)["status"] for path in (tmp_path / "s").glob("*/row.json")] == ["ok", "ok"]
