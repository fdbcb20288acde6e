"""Tab completion: what a shell is told, and that bash makes a word of it."""

import shutil
import subprocess
import sys

import pytest

from rhs.cli.completion import SHELLS, completions
from rhs.cli.main import main


@pytest.mark.parametrize(("line", "among"), [
    ("rhs ta", "table"), ("rhs plan", "planner="), ("rhs planner=rr", "planner=rrt_connect"),
    ("rhs planner=prm,rrt_s", "planner=prm,rrt_star"), ("rhs planner=prm planner.mil", "planner.milestones="),
    ("rhs world=square_s", "world=square_small"),
    ("rhs world=random:of", "world=random:office"), ("rhs experiment=", "experiment="), ("rhs --res", "--resume"),
    ("rhs mis", "mission."), ("rhs mission.kid", "mission.kidnap="), ("rhs mission.kidnap=", "mission.kidnap=true"),
    ("rhs source.rend", "source.renderer="), ("rhs source.renderer=t", "source.renderer=tinyrenderer"),
    ("rhs recording=j", "recording=jpeg"), ("rhs features.adv", "features.advanced."), ("rhs help col", "columns"),
    ("rhs -m engine=d", "engine=dask"), ("rhs task=planning world=ma", "world=map1"),
    ("rhs task=planning planning.sc", "planning.scenario="), ("rhs new pl", "planner"), ("rhs cache cl", "clear")])
def test_the_last_word_is_completed(line, among):
    found = completions(line)
    assert all(text.startswith(line.split(" ")[-1]) for text in found) and any(text.startswith(among) for text in found)


def test_options_are_those_of_the_command():
    of_table = completions("rhs table --")
    assert {"--group", "--rows", "--latex"} <= set(of_table) and "--jobs" not in of_table
    assert completions("rhs break world=home --ru") == ["--runs"] and completions("rhs cache --") == []


@pytest.mark.parametrize("line", ["rhs blame ", "rhs --resume ", "rhs -m --plugin ", "rhs report results/"])
def test_files_and_folders_are_left_to_the_shell(line):
    assert completions(line) == []


def test_settings_are_those_of_the_part_that_was_chosen():
    assert "planner.milestones=" not in completions("rhs planner=rrt planner.")
    assert completions("rhs planner=no_such planner.") == completions("rhs nonsense.") == []


@pytest.mark.parametrize("shell", [name for name in SHELLS if shutil.which(name)])
def test_a_shell_takes_the_script(shell, tmp_path, capsys):
    assert main(["completion", shell]) == 0
    (tmp_path / "script").write_text(capsys.readouterr().out)
    assert subprocess.run([shell, "-n", str(tmp_path / "script")], capture_output=True, text=True).stderr == ""


def test_bash_gets_what_follows_the_equals_sign(tmp_path):
    ask = (f'rhs() {{ "{sys.executable}" -m rhs "$@"; }}; source <(rhs completion bash); COMP_LINE="rhs planner=rrt_"; '
           'COMP_POINT=${#COMP_LINE}; _rhs; echo "${COMPREPLY[@]}"')
    told = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, timeout=60).stdout
    assert told.split() == ["rrt_connect", "rrt_star"]
