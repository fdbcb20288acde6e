"""`python -m rhs new KIND NAME [FOLDER]`: a package with a plugin that runs, to begin with."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from rhs.base.errors import ConfigError

# kind -> (imports, methods of the part)
PARTS = {
    "planner": ("from rhs.api.records import Path, PlanningProblem, PlanReason", '''
    def plan(self, problem: PlanningProblem) -> Path:
        """Straight to the goal, whatever stands between."""
        points = np.stack([problem.start_m, problem.goal_m])
        return Path(PlanReason.OK, points, points)
'''),
    "odometry": ("from rhs.api.geometry import se2\nfrom rhs.api.records import Motion, Observation, Revision, Tracking", '''
    def update(self, observation: Observation) -> Motion:
        """The wheels' motion; without wheels the robot stands still."""
        step = np.eye(4) if observation.wheel is None else se2(*observation.wheel)
        return Motion(step, 1e-4 * np.eye(6), Tracking.OK)

    def revise(self) -> Revision | None:
        return None
'''),
    "localiser": ("from rhs.api.belief import moved\nfrom rhs.api.records import Belief, Motion, Observation", '''
    def learn(self, views, grid) -> None:
        """Nothing is learnt."""

    def start(self, belief: Belief | None) -> None:
        self.belief = belief or Belief(np.eye(4), np.eye(6))

    def update(self, observation: Observation, motion: Motion) -> Belief:
        """The odometry is believed."""
        self.belief = moved(self.belief, motion)
        return self.belief
'''),
}


def main(words: Sequence[str]) -> int:
    """The command."""
    if len(words) not in (2, 3) or words[0] not in PARTS:
        raise ConfigError(f"new: say a kind ({', '.join(PARTS)}) and a name, for example: "
                          f"python -m rhs new planner my_planner")
    kind, name = words[0], words[1]
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise ConfigError(f"new {kind} {name}: a plugin's name is small letters, digits and _")
    folder = Path(words[2] if len(words) == 3 else name).expanduser()
    if folder.exists():
        raise ConfigError(f"{folder} exists already; name another folder: python -m rhs new {kind} {name} FOLDER")
    package = folder / name
    package.mkdir(parents=True)
    (folder / "pyproject.toml").write_text(_pyproject(kind, name), encoding="utf-8")
    (package / "__init__.py").write_text(_module(kind, name), encoding="utf-8")
    (folder / f"test_{name}.py").write_text(_test(kind, name), encoding="utf-8")
    sys.stdout.write(f"{package}/__init__.py\ntry it:    python -m rhs --plugin {package}/__init__.py {kind}={name}\n"
                     f"check it:  python -m rhs check --plugin {package}/__init__.py {kind}={name}\n"
                     f"keep it:   pip install -e {folder} && python -m rhs {kind}={name}\n")
    return 0


def _class(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _pyproject(kind: str, name: str) -> str:
    return f'''[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "{name.replace("_", "-")}"
version = "0.1.0"
dependencies = ["rhs"]

[project.entry-points."rhs.{kind}"]
{name} = "{name}:{_class(name)}"

[tool.hatch.build.targets.wheel]
packages = ["{name}"]
'''


def _module(kind: str, name: str) -> str:
    imports, methods = PARTS[kind]
    return f'''"""A {kind} for rhs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context
from rhs.api.errors import check_range
{imports}


@dataclass
class {_class(name)}:
    """What it does, in one line: --help shows it."""

    gain: float = 1.0
    """what this setting means, with its unit"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def __post_init__(self) -> None:
        check_range("{kind}", "gain", self.gain, low=0.0, high=10.0)

    def build(self, context: Context) -> Part:
        return Part(self, context.rng)


class Part:
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: {_class(name)}, rng: np.random.Generator) -> None:
        self.settings, self.rng = settings, rng
{methods}'''


def _test(kind: str, name: str) -> str:
    return f'''from {name} import {_class(name)}

from rhs.testing import check_plugin


def test_it_keeps_its_contract():
    check_plugin("{kind}", {_class(name)}())
'''
