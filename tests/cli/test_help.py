"""--help and help tell everything, quickly, without loading anything heavy."""

from __future__ import annotations

import contextlib
import dataclasses
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from installing import FAKES, environment, installed

from rhs.api import settings
from rhs.api.contracts import DEGRADE, KINDS, PLUGIN_KINDS
from rhs.base.errors import ConfigError
from rhs.cli.commands import COMMANDS, command
from rhs.cli.help_text import help_text, settings_text
from rhs.cli.main import main
from rhs.config import registry
from rhs.config.dictionary import lines
from rhs.config.documented import field_docs

HEAVY = ("cv2", "pybullet", "ompl", "numba", "scipy", "pandas", "matplotlib", "rosbags", "mcap", "hydra", "gtsam")


def test_every_plugin_and_every_setting_is_listed_with_its_default():
    text, short = settings_text(), help_text()
    for kind in (*KINDS, DEGRADE):
        assert f"  {kind}=" not in short and settings_text([kind]) in text
        for name in registry.names(kind):
            assert f"  {kind}={name}" in text and name in short
            if registry.failure(kind, name) is None:
                for key in settings.defaults(registry.load(kind, name)):
                    assert (f"    {kind}.{key}=" in text) == (key != "advanced")


def test_advanced_thresholds_stand_in_the_help_of_their_own_part_only():
    assert "localiser.advanced." not in settings_text()
    one = help_text(["localiser=sift_db"])
    assert "    localiser.advanced.places.rival_share=0.85" in one
    assert "    localiser.advanced.places.explain.near_deg=40.0" in one


def test_the_range_of_a_number_and_the_words_of_a_setting_are_said():
    text = help_text(["planner=prm"])
    assert "[int, 1 to 200000]" in text and "[native | ompl]" in text


def test_a_nested_threshold_out_of_range_names_its_whole_key():
    cls = registry.load("localiser", "sift_db")
    made = settings.make(cls, {"advanced": {"places": {"tie": 0.2}}}, "localiser")
    assert made.advanced.places.tie == 0.2 and made.advanced.places.slope == 12.0
    with pytest.raises(ConfigError, match=r"^localiser\.advanced\.places\.tie=3\.0 is outside"):
        settings.make(cls, {"advanced": {"places": {"tie": 3.0}}}, "localiser")


def test_what_is_not_said_of_a_nested_group_is_as_the_part_has_it():
    cls = registry.load("loop_closer", "pose_graph")
    made = settings.make(cls, {"advanced": {"scan_loops": {"match": {"beams": 40}}}}, "loop_closer")
    assert (made.advanced.scan_loops.match.beams, made.advanced.scan_loops.match.sigma_m) == (40, 0.05)


@dataclasses.dataclass
class Base:
    inherited: int = 1
    """from the base,
    on two lines"""
    replaced: float = 2.0
    """as the base has it"""


@dataclasses.dataclass
class Derived(Base):
    replaced: float = 3.0
    """as the derived class has it"""
    silent: str = ""


def test_the_meaning_of_a_setting_is_the_string_literal_after_it_base_classes_included():
    assert field_docs(Derived) == {"inherited": "from the base, on two lines", "replaced": "as the derived class has it",
                                   "silent": ""}


def test_a_plugin_that_cannot_be_imported_is_listed_with_the_reason():
    with installed(FAKES):
        text = " ".join(settings_text().split())
        one = help_text(["planner=fake"])
    assert "planner=broken NOT USABLE" in text
    assert "No module named 'a_module_nobody_has'" in text
    assert "planner=exits NOT USABLE" in text
    assert "planner.step_m=0.5" in one
    assert "longest edge, metres [float]" in one
    assert "sensor" not in one


@pytest.mark.parametrize("words", [["--help"], ["planner=fake", "--help"], ["help", "settings"]])
def test_help_loads_no_heavy_library(words):
    code = ("import sys; from rhs.cli.main import main; assert main(sys.argv[1:]) == 0;"
            f"bad = [m for m in {HEAVY!r} if m in sys.modules]; print('LOADED', bad, file=sys.stderr)")
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60,
                          env=environment(FAKES), check=True)
    assert "LOADED []" in done.stderr
    assert "fake" in done.stdout


def test_help_is_read_in_a_minute_and_begins_with_what_is_taken_by_default():
    lines = help_text().splitlines()
    assert len(lines) < 150
    first = {tuple(line.split(",")[0].split()) for line in lines}
    assert {("odometry", "keyframe"), ("planner", "prm"), ("sensor", "rgbd")} <= first


def test_help_of_every_kind_lists_its_parts(capsys):
    for kind in PLUGIN_KINDS:
        assert command(["help", kind])() == 0
        said = capsys.readouterr().out
        assert all(f"  {kind}={name}" in said for name in registry.names(kind)), kind
    assert "tracked_share" in settings_text(["metric"])


def test_help_of_a_part_is_that_part_in_full_whatever_its_kind(capsys):
    assert command(["help", "localise"])() == 0
    assert "task=localise" in (said := capsys.readouterr().out) and "kidnap_every_m=0.0" in said
    assert command(["help", "none"])() == 0 and "loop_closer=none" in capsys.readouterr().out


def test_help_of_what_there_is_not_says_what_there_is(capsys):
    with pytest.raises(ConfigError, match=r"help planers: .*; did you mean planner\? \(there is commands, columns, "):
        command(["help", "planers"])()
    with pytest.raises(ConfigError, match="^planner is a kind of part: type planner=NAME, or python -m rhs help planner"):
        command(["planner"])
    assert not capsys.readouterr().out


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_explains_itself(name, capsys):
    """`COMMAND --help` ends well and shows how the command is typed."""
    with contextlib.suppress(SystemExit):  # argparse leaves by it
        assert command([name, "--help"])() == 0
    said = capsys.readouterr()
    assert f"rhs {name}" in said.out or f"rhs.{name}" in said.out
    assert not said.err


@pytest.mark.parametrize("before", [[], ["check"]])
def test_a_file_that_stands_alone_says_what_to_write_before_it(tmp_path, capsys, before):
    (tmp_path / "walk.bag").write_bytes(b"#ROSBAG V2.0\n")
    assert main([*before, str(tmp_path / "walk.bag")]) == 2
    assert "for a recording write source=replay source.path= before it" in capsys.readouterr().err


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in ("help", "worlds", "table", "cache")])
def test_a_command_without_its_words_says_what_is_missing_as_every_complaint_begins(name, capsys):
    assert main([name]) == 2
    err = capsys.readouterr().err
    assert err.startswith("rhs: ") and err.count("\n") == 1
    assert "key=value" not in err.partition("example")[0].partition(";")[0], "which may be left out"


def test_help_tells_what_one_column_or_event_means(capsys):
    assert main(["help", "belief_ece"]) == 0 and "expected calibration error" in capsys.readouterr().out
    assert main(["help", "arrived"]) == 0
    assert [line for line in capsys.readouterr().out.splitlines() if line and line[0] != " "] == [
        "Events (steps.csv, event)", "Mission statuses (missions.json)"]
    assert main(["help", "belief_ec"]) == 2 and "did you mean belief_ece?" in capsys.readouterr().err


def test_the_site_has_a_page_of_every_column_event_and_status():
    page = runpy.run_path(str(Path(__file__).parents[2] / ".ci" / "site.py"))["columns_page"]()
    for title, name, _ in lines():
        assert f"\n## {title}\n" in page and f"\n| `{name}` | " in page
    assert all(line.replace("\\|", "").count("|") == 3 for line in page.splitlines() if line.startswith("|"))
