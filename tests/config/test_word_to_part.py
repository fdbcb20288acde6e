"""How many files somebody opens who follows a word of the command line until it is a part."""

import sys
from pathlib import Path

from helpers.built_parts import build_parts

import rhs
from rhs.config.compose import compose_config
from rhs.worlds.world import load_world

ROOT = Path(rhs.__file__).parent
MOST = 6


def test_a_word_becomes_a_part_through_six_files(tmp_path):
    """overrides (the word), compose, hydra_glue (Hydra's part), registry (the plugin), api/settings (types), parts (built).
    Counted by running it: files of the configuration in which a function is entered, and the one that makes settings."""
    entered = set()

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_name != "<module>":
            entered.add(Path(frame.f_code.co_filename))

    world = load_world("square_small")
    sys.setprofile(note)
    try:
        parts = build_parts(compose_config(["world=square_small", "planner=prm"]), world, tmp_path)
    finally:
        sys.setprofile(None)
    parts.source.close()
    mine = {path for path in entered if path.is_relative_to(ROOT / "config") or path == ROOT / "api" / "settings.py"}
    assert {path.name for path in mine} >= {"overrides.py", "compose.py", "registry.py", "parts.py"}
    assert len(mine) <= MOST, sorted(str(path.relative_to(ROOT)) for path in mine)
