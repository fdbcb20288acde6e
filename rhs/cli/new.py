"""`python -m rhs new KIND NAME [FOLDER]`: a package with a plugin that runs, to begin with.

    python -m rhs new planner my_planner             the folder my_planner, with pyproject.toml, a part and its test
    python -m rhs new odometry mine plugins_of_mine

KIND: planner, odometry or localiser. What it writes keeps its contract as it stands; exit code 2 where the folder exists.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rhs.api.contracts import PROTOCOLS
from rhs.base.errors import ConfigError
from rhs.config.loose import class_name


@dataclass(frozen=True)
class Skeleton:
    """What differs between the kinds: a part that works and keeps its contract, with one setting."""

    imports: str
    does: str
    setting: str
    methods: str
    needs: str = ""


SKELETONS = {
    "planner": Skeleton("from rhs.api.records import Path, PlanningProblem, PlanReason",
                        "Breadth-first search over the cells.", '''
    most_cells: int = 1_000_000
    """cells that are looked at before it gives up"""

    def __post_init__(self) -> None:
        check_range("planner", "most_cells", self.most_cells, low=1, high=1_000_000_000)
''', '''
    def plan(self, problem: PlanningProblem) -> Path:
        """Cell by cell from the start, to the four neighbours, until the goal is reached."""
        origin, side = np.array(problem.origin_m), problem.resolution_m
        first, last = (tuple(np.floor((point - origin) / side).astype(int)[::-1])
                       for point in (problem.start_m, problem.goal_m))
        for cell, blocked in ((first, PlanReason.START_BLOCKED), (last, PlanReason.GOAL_BLOCKED)):
            if not all(0 <= n < most for n, most in zip(cell, problem.blocked.shape, strict=True)):
                return Path(PlanReason.OUTSIDE, np.empty((0, 2)))
            if problem.blocked[cell]:
                return Path(blocked, np.empty((0, 2)))
        before, reason = self._search(problem.blocked, first, last)
        if reason is not PlanReason.OK:
            return Path(reason, np.empty((0, 2)))
        cells = [last]
        while cells[-1] != first:
            cells.append(before[cells[-1]])
        centres = origin + (np.array(cells[::-1])[:, ::-1] + 0.5) * side
        return Path(PlanReason.OK, np.vstack([problem.start_m, centres, problem.goal_m]))

    def _search(self, blocked: np.ndarray, first: tuple, last: tuple) -> tuple[dict, PlanReason]:
        """The cell before each cell that was reached, and how it ended."""
        before, waiting = {first: first}, deque([first])
        while waiting and last not in before:
            if len(before) > self.settings.most_cells:
                return before, PlanReason.BUDGET_SPENT
            row, column = waiting.popleft()
            for cell in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
                inside = 0 <= cell[0] < blocked.shape[0] and 0 <= cell[1] < blocked.shape[1]
                if inside and not blocked[cell] and cell not in before:
                    before[cell] = (row, column)
                    waiting.append(cell)
        return before, PlanReason.OK if last in before else PlanReason.DISCONNECTED
'''),
    "odometry": Skeleton("from rhs.api.geometry import se2\n"
                         "from rhs.api.records import Motion, Observation, Revision, Tracking",
                         "The wheels are believed.", '''
    share: float = 0.1
    """standard deviation of a step, as a share of it"""

    def __post_init__(self) -> None:
        check_range("odometry", "share", self.share, low=0.0, high=1.0)
''', '''
    first: bool = True

    def update(self, observation: Observation) -> Motion:
        """The pose of this view as seen from the view before. The first has none before it."""
        first, self.first = self.first, False
        if first:
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK)
        if observation.wheel is None:
            return Motion(np.eye(4), np.eye(6), Tracking.LOST, reason="no wheels")
        x, y, yaw = observation.wheel
        sigma_m = 1e-3 + self.settings.share * np.hypot(x, y)
        sigma_rad = 1e-3 + self.settings.share * abs(yaw)
        sigmas = np.array([sigma_m, sigma_m, 1e-3, 1e-3, 1e-3, sigma_rad])  # x, y, z in metres, turns about them
        return Motion(se2(x, y, yaw), np.diag(sigmas**2), Tracking.OK)

    def revise(self) -> Revision | None:
        """Nothing that was said is taken back."""
        return None
''', '"wheel"'),
    "localiser": Skeleton("from rhs.api.belief import moved\n"
                          "from rhs.api.records import Belief, BeliefStatus, Motion, Observation",
                          "The odometry is believed.", '''
    lost_m: float = 10.0
    """standard deviation of a position that is not known"""

    def __post_init__(self) -> None:
        check_range("localiser", "lost_m", self.lost_m, low=0.1, high=1e4)
''', '''
    def learn(self, views, grid) -> None:
        """The survey's views and map: a better localiser remembers places here."""

    def start(self, belief: Belief | None) -> None:
        """None: nobody knows where the robot is."""
        anywhere = np.diag([self.settings.lost_m**2] * 3 + [10.0] * 3)
        self.belief = belief or Belief(np.eye(4), anywhere, BeliefStatus.LOST, 0.0)

    def update(self, observation: Observation, motion: Motion) -> Belief:
        """The belief, moved on by the odometry."""
        self.belief = moved(self.belief, motion)
        return self.belief
'''),
}


def main(words: Sequence[str]) -> int:
    """The command."""
    if words and words[0] in PROTOCOLS and words[0] not in SKELETONS:
        protocol = PROTOCOLS[words[0]]
        raise ConfigError(f"new: there is none of a {words[0]}; do what {protocol.__module__}.{protocol.__name__} asks, "
                          f"then python -m rhs check --plugin FILE.py {words[0]}=NAME")
    if len(words) not in (2, 3) or words[0] not in SKELETONS:
        raise ConfigError(f"new: say a kind ({', '.join(SKELETONS)}) and a name, for example: "
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


def _module(kind: str, name: str) -> str:
    skeleton = SKELETONS[kind]
    queue = "from collections import deque\n" if "deque" in skeleton.methods else ""
    needs = f"{{{skeleton.needs}}}" if skeleton.needs else ""
    return f'''"""A {kind} for rhs."""

from __future__ import annotations

{queue}from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import check_range
from rhs.api.contracts import Context
{skeleton.imports}


@dataclass
class {class_name(name)}:
    """{skeleton.does}"""
{skeleton.setting}
    needs: ClassVar[frozenset[str]] = frozenset({needs})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context.rng)


class Part:
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: {class_name(name)}, rng: np.random.Generator) -> None:
        self.settings, self.rng = settings, rng
{skeleton.methods}'''


def _test(kind: str, name: str) -> str:
    return f'''from {name} import {class_name(name)}

from rhs.testing import check_plugin


def test_it_keeps_its_contract():
    check_plugin("{kind}", {class_name(name)}())
'''
