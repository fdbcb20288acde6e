"""What the planning task plans in: a map with start, goal and robot radius, from any kind of file.

`world=` may name a map of worlds/maps or a world of worlds/, or be the path of a map_server YAML, a world YAML, a
MovingAI `.map` or a `.scen` (then `planning.scenario` says which of its problems).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np

from rhs.api.floorplan import World, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.base.errors import ConfigError

from .buildings import FOREIGN
from .maps import load_map, read_yaml
from .movingai import centre_m, load_movingai_map, load_scenarios
from .random.names import is_random
from .world import find_world, load_world

_KEYS = ("start", "goal", "robot_radius_m", "classes")


@dataclass(frozen=True, eq=False)
class Arena:
    """A map to plan in. start_m, goal_m: (2,) metres or None where the file names none. robot_radius_m: the map is grown
    by it. classes: names and gate segments (2, 2) metres that tell ways round an obstacle apart. octile_m: shortest
    eight-connected length that a scenario file claims, NaN without one."""

    name: str
    grid: OccupancyGrid
    start_m: np.ndarray | None = None
    goal_m: np.ndarray | None = None
    robot_radius_m: float = 0.0
    classes: tuple[tuple[str, np.ndarray], ...] = ()
    octile_m: float = float("nan")


def load_arena(name_or_path: str, *, scenario: int = 0, seed: int = 0) -> Arena:
    """The arena of that name or path; seed: of a drawn world without a number. Raises ConfigError in one line."""
    if is_random(name_or_path):
        return _world(load_world(name_or_path, seed=seed))
    path = find_world(name_or_path, maps=True)
    if path.suffix == ".scen":
        return _scenario(path, scenario)
    if scenario:
        raise ConfigError(f"planning.scenario={scenario}: only a .scen file has several problems, {path.name} is none")
    if path.suffix == ".map":
        return Arena(path.stem, load_movingai_map(path))
    if path.suffix.lower() in FOREIGN:
        return _world(load_world(path))
    keys = read_yaml(path)
    if "image" in keys:
        return _map_server(path, keys.get("planning", {}))
    return _world(load_world(path))


def class_of(points_m: np.ndarray, classes: tuple[tuple[str, np.ndarray], ...]) -> str:
    """Names of the gates that a path (N, 2) crosses, in the order of the file, joined by +; empty for none."""
    points = np.asarray(points_m, float)
    crossed = [name for name, gate in classes if len(points) > 1 and _crosses(points, gate)]
    return "+".join(crossed)


def _crosses(points: np.ndarray, gate: np.ndarray) -> bool:
    """Some segment of the polyline meets the gate."""
    (ax, ay), (bx, by) = gate
    side = (bx - ax) * (points[:, 1] - ay) - (by - ay) * (points[:, 0] - ax)
    p, q = points[:-1], points[1:]
    along = [(q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0]) for x, y in gate]
    return bool(np.any((side[:-1] * side[1:] <= 0) & (along[0] * along[1] <= 0) & (side[:-1] != side[1:])))


def _map_server(path: FilePath, planning: object) -> Arena:
    grid = load_map(path)
    if not isinstance(planning, dict):
        raise ConfigError(f"{path}: planning: expected keys and values, found {planning!r}")
    for key in planning:
        if key not in _KEYS:
            raise ConfigError(f"{path}: unknown key planning.{key}; known keys: {', '.join(_KEYS)}")
    classes = planning.get("classes", {})
    if not isinstance(classes, dict):
        raise ConfigError(f"{path}: planning.classes: expected `name: [[x, y], [x, y]]` lines")
    gates = tuple((str(name), _points(path, f"classes.{name}", gate, 2)) for name, gate in classes.items())
    ends = {key: _points(path, key, [planning[key]], 1)[0] for key in ("start", "goal") if key in planning}
    radius = planning.get("robot_radius_m", 0.0)
    if not isinstance(radius, int | float) or not 0.0 <= radius <= 100.0:
        raise ConfigError(f"{path}: planning.robot_radius_m is {radius!r}; expected metres in [0, 100]")
    return Arena(path.stem, grid, ends.get("start"), ends.get("goal"), float(radius), gates)


def _points(path: FilePath, key: str, values: object, count: int) -> np.ndarray:
    """(count, 2) finite metres."""
    try:
        points = np.array(values, float)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.shape != (count, 2) or not np.isfinite(points).all():
        expected = "[x, y]" if count == 1 else "[[x, y], [x, y]]"
        raise ConfigError(f"{path}: planning.{key} is {values!r}; expected {expected} in metres")
    return points


def _world(world: World) -> Arena:
    """The true plan of a world; from its start to its first place."""
    goal = np.array(world.places[0][1:]) if world.places else None
    return Arena(world.name, truth_grid(world), np.array(world.start[:2]), goal, world.robot_radius_m)


def _scenario(path: FilePath, number: int) -> Arena:
    problems = load_scenarios(path)
    if not 0 <= number < len(problems):
        raise ConfigError(f"planning.scenario={number}: {path.name} has the problems 0 to {len(problems) - 1}")
    problem = problems[number]
    places = [path.parent / problem.map_name, path.parent / FilePath(problem.map_name).name]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise ConfigError(f"{path}: its map {problem.map_name} is not beside it; put it into {path.parent}")
    arena = Arena(path.name, load_movingai_map(found))
    if arena.grid.shape != (problem.size[1], problem.size[0]):
        height, width = arena.grid.shape
        raise ConfigError(f"{found}: {width} x {height} cells, but {path.name} says {problem.size[0]} x {problem.size[1]}")
    return replace(arena, start_m=np.array(centre_m(problem.start)), goal_m=np.array(centre_m(problem.goal)),
                   octile_m=problem.optimal_cells)
