"""`python -m rhs new KIND NAME [FOLDER]`: a package with a plugin that runs, to begin with.

    python -m rhs new planner my_planner             the folder my_planner, with pyproject.toml, a part and its test
    python -m rhs new odometry mine plugins_of_mine

KIND is any kind of plugin. What it writes keeps its contract as it stands; exit code 2 where the folder exists.
"""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from rhs.api.contracts import PLUGIN_KINDS, PROTOCOLS
from rhs.api.settings import nearest
from rhs.base.errors import ConfigError
from rhs.config.loose import class_name

HERE = Path(__file__).parent / "skeletons"
SMALL = "world=square_small"
# What is typed beside kind=name to try one: what the skeleton needs, and a small building.
BESIDE = {"source": "sensor=laser task=survey",
          "sensor": f"source.laser_beams=360 odometry=scan_to_map loop_closer=scan_graph task=survey {SMALL}",
          "slam": f"sensor=laser sensor.noise=false task=survey {SMALL}", "engine": f"{SMALL} seed=0,1"}


def main(words: Sequence[str]) -> int:
    """The command."""
    if len(words) not in (2, 3) or words[0] not in PLUGIN_KINDS:
        unknown = words and words[0] not in PLUGIN_KINDS
        wrong = f"{words[0]} is no kind{nearest(words[0], list(PLUGIN_KINDS))}" if unknown else "say a kind and a name"
        raise ConfigError(f"new: {wrong}; for example: python -m rhs new planner my_planner; "
                          f"kinds: {', '.join(PLUGIN_KINDS)}")
    kind, name = words[0], words[1]
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise ConfigError(f"new {kind} {name}: a plugin's name is small letters, digits and _, and no word of Python")
    folder = Path(words[2].removeprefix("output=") if len(words) == 3 else name).expanduser()
    if folder.exists():
        raise ConfigError(f"{folder} exists already; name another folder: python -m rhs new {kind} {name} FOLDER")
    module = folder / name / "__init__.py"
    module.parent.mkdir(parents=True)
    (folder / "pyproject.toml").write_text(_pyproject(kind, name), encoding="utf-8")
    skeleton = (HERE / f"{kind}.py").read_text(encoding="utf-8")
    module.write_text(skeleton.replace("Skeleton", class_name(name)), encoding="utf-8")
    if kind in PROTOCOLS and kind != "engine":
        (folder / f"test_{name}.py").write_text(_test(kind, name), encoding="utf-8")
    sys.stdout.write("\n".join([str(module), *_next(kind, name, folder, module), ""]))
    return 0


def _next(kind: str, name: str, folder: Path, module: Path) -> list[str]:
    """What to type now."""
    python, plugin = f"python -m rhs{' -m' if kind == 'engine' else ''}", f"--plugin {module}"
    words = BESIDE.get(kind, SMALL) if kind == "metric" else f"{kind}={name} {BESIDE.get(kind, SMALL)}"
    check = f"check it:  python -m rhs check {plugin} {kind}={name}"
    return [f"try it:    {python} {plugin} {words}", *([check] if kind in PROTOCOLS and kind != "engine" else []),
            f"keep it:   pip install -e {folder} && {python} {words}"]


def _pyproject(kind: str, name: str) -> str:
    return f'''[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "{name.replace("_", "-")}"
version = "0.1.0"
dependencies = ["rhs"]

[project.entry-points."rhs.{kind}"]
{name} = "{name}:{class_name(name)}"

[tool.hatch.build.targets.wheel]
packages = ["{name}"]
'''


def _test(kind: str, name: str) -> str:
    return f'''from {name} import {class_name(name)}

from rhs.testing import check_plugin


def test_it_keeps_its_contract():
    check_plugin("{kind}", {class_name(name)}())
'''
