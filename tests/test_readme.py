"""What the README tells people to type can be typed."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from rhs.cli.commands import COMMANDS
from rhs.cli.main import main
from rhs.config.compose import compose_config

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted(ROOT.glob("*/README.md")), *sorted(ROOT.glob("rhs/*/README.md")),
         ROOT / "plugins" / "rhs_planners" / "README.md"]


def blocks(page: Path) -> list[str]:
    """The texts between lines of three back-ticks."""
    return re.findall(r"^```[a-z]*\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)


def commands(page: Path) -> list[list[str]]:
    """Every `python -m rhs ...` of a page, as words."""
    lines = [line.strip().removeprefix("$ ") for block in blocks(page)
             for line in block.replace("\\\n", " ").splitlines()]
    words = [shlex.split(part, comments=True) for line in lines if "python -m rhs" in line for part in line.split("&&")]
    return [found[3:] for found in words if found[:3] == ["python", "-m", "rhs"]]


CASES = [pytest.param(words, id=f"{page.parent.name}: {' '.join(words) or '(nothing)'}")
         for page in PAGES for words in commands(page)]


def test_the_pages_name_commands():
    assert len(CASES) >= 5


@pytest.mark.parametrize("words", CASES)
def test_a_command_of_a_page_is_understood(words, tmp_path, monkeypatch, capfd):
    """It is composed and checked, not run: `--cfg` prints the configuration, or the jobs of a sweep."""
    monkeypatch.chdir(tmp_path)
    if words[:1] and words[0] in COMMANDS:
        return
    if any("my_" in word or word.isupper() or word in ("...", "my.py") for word in words) or "--resume" in words:
        pytest.skip("an example with a name to fill in")
    if any(word.startswith("live=") for word in words):
        pytest.importorskip("rerun")
    assert main([*words] if "--help" in words else [*words, "--cfg"]) == 0, capfd.readouterr().err
    assert capfd.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_the_words_of_the_notebook_example_are_understood():
    python = "".join(block for block in blocks(ROOT / "README.md") if "rhs.run(" in block)
    words = re.search(r"rhs\.run\((\[.*?\])\)", python)
    assert words is not None
    assert compose_config(re.findall(r'"(.*?)"', words.group(1))).world


def test_ci_installs_and_tests_as_the_readme_says():
    told = [line for block in blocks(ROOT / "README.md") for line in block.splitlines()]
    script = (ROOT / ".ci" / "run").read_text()
    assert "pip install -e '.[test]'" in told
    assert "python -m pytest" in told
    assert re.search(r"pip install .*-e '\.\[test(,\w+)*\]'", script)
    assert re.search(r"^python -m pytest$", script, re.M)
