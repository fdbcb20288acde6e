"""A planner by somebody else, in a project of its own, is a planner like any other."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, HERE, environment, installed, installed_project

from rhs.api.errors import PluginError
from rhs.cli.help_text import settings_text
from rhs.config import registry
from rhs.config.compose import compose_config

PROJECT = HERE / "thirdparty"
STRANGER = [word for word in CHOICE if not word.startswith("planner=")] + ["planner=straight_line"]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder that holds the project as pip would have installed it."""
    return installed_project(PROJECT, tmp_path_factory.mktemp("site"))


def rhs(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES, site),
                          capture_output=True, text=True, timeout=120)


def test_it_is_listed_without_being_imported(site):
    with installed(FAKES, site):
        assert "straight_line" in registry.names("planner")
        assert "straight_line_planner" not in sys.modules


def test_it_is_chosen_and_set(site):
    with installed(FAKES, site):
        config = compose_config([*STRANGER, "planner.step_m=0.2"])
    assert config.planner.name == "straight_line"
    assert config.planner.settings.step_m == 0.2


def test_its_answer_to_a_blocked_way_keeps_the_contract(site):
    from rhs.testing import check_plugin

    with installed(FAKES, site):
        config = compose_config([*STRANGER, "replan=polite", "replan.views=3"])
        check_plugin("replan", config.parts["replan"].settings)
    assert (config.parts["replan"].name, config.parts["replan"].settings.views) == ("polite", 3)


def test_help_tells_its_settings_their_meaning_and_where_it_comes_from(site):
    with installed(FAKES, site):
        text = " ".join(settings_text(["planner"]).split())
    assert "planner=straight_line Goes straight to the goal, or not at all. (from straight-line-planner 0.3)" in text
    assert "planner.step_m=0.05 distance between the points at which the line is looked at, metres [float]" in text


@pytest.mark.parametrize(("words", "says"), [
    (["planner.stp_m=0.2"], "unknown key planner.stp_m; did you mean planner.step_m?"),
    (["planner.step_m=0"], "planner.straight_line.step_m=0.0 is outside the allowed range [0.01, 1] m"),
    (["planner.step_m=far"], "planner.step_m=far: expected float"),
])
def test_its_settings_are_checked_like_any(site, tmp_path, words, says):
    done = rhs(site, tmp_path, *STRANGER, *words)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_patrol_is_driven_on_its_plans(site, tmp_path):
    done = rhs(site, tmp_path, *STRANGER, "output=run")
    assert done.returncode == 0, done.stderr
    assert '"planner": "straight_line"' in (tmp_path / "run" / "row.json").read_text()


def test_it_is_swept_against_another(site, tmp_path):
    others = [word for word in CHOICE if not word.startswith("planner=")]
    done = rhs(site, tmp_path, "-m", *others, "planner=straight_line,fake", "seed=0,1", "output=sweep", "--jobs", "2")
    assert done.returncode == 0, done.stderr
    assert "4 jobs: 4 ok" in done.stdout
    assert "straight_line" in (tmp_path / "sweep" / "table.csv").read_text()


def test_when_broken_it_is_refused_with_its_origin_and_others_still_run(tmp_path):
    site = installed_project(PROJECT, tmp_path / "site")
    (site / "straight_line_planner" / "__init__.py").write_text("import no_such_thing\n")
    done = rhs(site, tmp_path, *STRANGER)
    assert done.returncode == 2
    assert ("planner=straight_line (straight_line_planner:StraightLine from straight-line-planner 0.3) cannot be "
            "imported: ModuleNotFoundError: No module named 'no_such_thing'") in done.stderr
    assert rhs(site, tmp_path, *CHOICE, "--cfg").returncode == 0


def test_a_second_plugin_of_one_name_is_refused_with_both_origins(site, tmp_path):
    other = installed_project(PROJECT, tmp_path)
    metadata = next(other.glob("*.dist-info"))
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: impostor\nVersion: 9\n")
    metadata.rename(metadata.with_name("impostor-9.dist-info"))
    with installed(FAKES, site, other), pytest.raises(PluginError) as caught:
        compose_config(STRANGER)
    assert "registered twice" in str(caught.value)
    assert "straight-line-planner 0.3" in str(caught.value)
    assert "impostor 9" in str(caught.value)


def test_who_takes_a_name_of_ours_is_to_be_renamed_and_not_rhs_uninstalled(tmp_path):
    entry = tmp_path / "taker-1.dist-info"
    entry.mkdir()
    (entry / "METADATA").write_text("Metadata-Version: 2.1\nName: taker\nVersion: 1\n")
    (entry / "entry_points.txt").write_text("[rhs.planner]\nprm = taker:Prm\n")
    with installed(tmp_path), pytest.raises(PluginError, match="; rename one of them, or uninstall taker 1$"):
        registry.load("planner", "prm")


def test_a_module_that_is_another_packages_is_named_by_its_file(tmp_path):
    for name, module in (("one", "rhs.api.nothing_there:A"), ("two", "straight_lines:B")):
        entry = tmp_path / f"{name}-1.dist-info"
        entry.mkdir()
        (entry / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        (entry / "entry_points.txt").write_text(f"[rhs.planner]\n{name} = user_{name}:P\nother_{name} = {module}\n")
    (tmp_path / "straight_lines.py").write_text("A = 1\n")
    (tmp_path / "user_one.py").write_text("import rhs.api.nothing_there\n")
    with installed(tmp_path):
        said = {name: str(registry.failure("planner", name)) for name in ("one", "other_two")}
    assert "No module named 'rhs.api.nothing_there' (user_one.py:1)" in said["one"] and "pip install" not in said["one"]
    assert f"no attribute 'B' ({tmp_path / 'straight_lines.py'})" in said["other_two"]
