"""Read a world from its YAML file (format: worlds/README.md), or from somebody else's building (buildings.py), and refuse
it, in one line, when something is wrong."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.floorplan import (
    Blank,
    Box,
    Changes,
    Light,
    Paintings,
    Surface,
    Wall,
    World,
    mapping_grid_frame,
    truth_grid,
)
from rhs.api.settings import near_file
from rhs.base.data_dirs import data_dir
from rhs.base.errors import ConfigError

from .buildings import FOREIGN, RADIUS_M, longest_route_m, peopled, read_building, settled
from .map_walls import Building
from .random.names import FAMILIES, PREFIX, is_random
from .robot import inherit, put_robot, shape_of
from .world_checks import check_extent, check_world
from .world_moving import moving_of
from .world_yaml import FAR_M, Section, no_keys, read_yaml

__all__ = ["Box", "Paintings", "Surface", "Wall", "World", "load_world", "mapping_grid_frame", "truth_grid",
           "world_names"]

RECIPES = ("plaster", "brick", "wood", "carpet", "tiles", "plain")
WALL = Surface("plaster", (200.0, 195.0, 185.0), 12.0)
FLOOR = Surface("carpet", (120.0, 105.0, 95.0), 30.0)
CEILING = Surface("tiles", (215.0, 215.0, 210.0), 12.0)
FURNITURE = Surface("wood", (150.0, 110.0, 70.0), 20.0)


def load_world(name_or_path: str | Path, *, seed: int = 0, robot: Mapping[str, Any] | None = None) -> World:
    """A world by the name of a file in worlds/, or by path; or a drawn one, `random:FAMILY` (rhs.worlds.random.names), whose
    number is `seed` where its name has none. robot: `robot_radius_m` or `footprint_m` (corners), `camera_height_m`, and of
    somebody else's building `survey_m`, metres, in place of what it says. Raises ConfigError: one line, with advice."""
    robot = robot or {}
    if is_random(name_or_path):
        _none_proposed(str(name_or_path), robot)
        from .random.building import random_world

        return random_world(str(name_or_path), seed, robot)
    path = find_world(name_or_path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        return _foreign(path, path, put_robot(no_keys(path), robot))
    file = read_yaml(path)
    if _is_flat_map(file) or "levels" in file.nodes:
        return _foreign(path, path, put_robot(no_keys(path), robot))
    put_robot(file, robot)
    if "building" in file.nodes:
        return _foreign(path, path.parent / Path(file.text("building")).expanduser(), file)
    _none_proposed(path.stem, robot)
    base_name = file.text("like", "")
    if base_name:
        base = read_yaml(find_world(base_name, beside=path.parent))
        if "like" in base.nodes:
            raise ConfigError(f"{file.where('like')}: like: '{base_name}' is itself like another world; name that one")
        inherit(file, base)
    world = _world(path, file)
    check_world(world, file)
    return world


def _none_proposed(name: str, robot: Mapping[str, Any]) -> None:
    if "survey_m" in robot:
        raise ConfigError(f"source.survey_m={robot['survey_m']:g} is of a survey that is proposed, for a map, plan, mesh or "
                          f"scene; {name} has its own: leave out source.survey_m")


def _foreign(path: Path, building_path: Path, file: Section) -> World:
    """Somebody else's building; what the file does not say about start, places and route is proposed."""
    longest_route_m(file)
    building = read_building(building_path, file)
    world = _world(path, file, building)
    check_extent(world, file)
    world = peopled(settled(world, building, file), building)
    check_world(world, file)
    return world


def world_names() -> list[str]:
    """Names of the buildings that come with the program (worlds/ may also hold flat maps for planning)."""
    return sorted(path.stem for path in data_dir("worlds").glob("*.yaml") if not _is_flat_map(read_yaml(path)))


def _is_flat_map(file: Section) -> bool:
    return "image" in file.nodes and "walls" not in file.nodes


def find_world(name_or_path: str | Path, *, beside: Path | None = None, maps: bool = False) -> Path:
    """The file of a world: a name is looked for in `beside` and worlds/; anything with a slash or a file's ending is a
    path. maps: flat maps and scenarios for planning are worlds too."""
    text, endings = str(name_or_path), (".yaml", ".yml", *((".map", ".scen") if maps else ()), *FOREIGN)
    if "/" in text or Path(text).suffix.lower() in endings or ("." in text and Path(text).is_file()):
        path = Path(text).expanduser()
        if path.is_dir():
            inner = sorted(one.name for one in path.iterdir() if one.suffix.lower() in endings)
            named = f"type world={path / inner[0]}" if inner else "expected a file: a map, a plan, a scene or a mesh"
            raise ConfigError(f"world={text} is a folder; {named}")
        if not path.is_file():
            raise ConfigError(f"world={text}: there is no such file{near_file(path)}")
        return path.resolve()
    flat = [data_dir("worlds") / "maps"] if maps else []
    for folder in [*([beside] if beside else []), *flat, data_dir("worlds")]:
        if text and (folder / f"{text}.yaml").is_file():
            return folder / f"{text}.yaml"
    drawn = [f"{PREFIX}{family}" for family in FAMILIES]
    known = [*(path.stem for folder in flat for path in sorted(folder.glob("*.yaml"))), *world_names()]
    near = difflib.get_close_matches(text, [*known, *drawn], n=1, cutoff=0.5)
    advice = f"did you mean '{near[0]}'?" if near else f"worlds: {', '.join(known)}; drawn ones: {', '.join(drawn)}"
    what = "neither a map nor a world nor the path of one" if maps else "neither a world nor a path to a YAML file"
    raise ConfigError(f"world={text} is {what}; {advice}")


def _world(path: Path, file: Section, building: Building | None = None) -> World:
    """What the file says. With a building it need name neither walls nor start nor route: `settled` finds them."""
    x_m, y_m, yaw_deg = file.numbers("start", None if building is None else (0.0, 0.0, 0.0), count=3, low=-FAR_M, high=FAR_M)
    walls_and_pilasters = [_wall(section) for section in file.sections("walls", required=building is None)]
    if building is None and not walls_and_pilasters:
        raise ConfigError(f"{file.where('walls')}: walls is empty; a world needs walls around its start")
    walls = (() if building is None else building.walls) + tuple(wall for wall, _ in walls_and_pilasters)
    places = file.section("places")
    radius_m, footprint = shape_of(file, 0.3 if building is None else RADIUS_M)
    world = World(
        name=path.parent.name if path.name == "model.sdf" else path.stem,  # as Gazebo names its models
        path=path,
        start=(x_m, y_m, float(np.radians(yaw_deg))),
        robot_radius_m=radius_m,
        camera_height_m=file.number("camera_height_m", 1.2 if building is None else building.camera_height_m,
                                    low=0.1, high=3.0),
        walls=walls,
        boxes=(*(b for _, boxes in walls_and_pilasters for b in boxes), *map(_box, file.sections("boxes"))),
        obstacles=tuple(map(_box, file.sections("obstacles"))),
        places=tuple((name, *_point(places, name)) for name in places.keys()),
        route_m=file.points("route_m") if building is None or "route_m" in file.nodes else np.zeros((0, 2)),
        paintings=_paintings(file.section("paintings")),
        floor=_surface(file.section("floor"), FLOOR),
        ceiling=_surface(file.section("ceiling"), CEILING),
        seed=file.whole("seed", 0),
        mesh=None if building is None else building.mesh,
        moving=moving_of(file, _box, _surface),
        camera_pitch_deg=file.number("camera_pitch_deg", 0.0, low=-45.0, high=60.0),
        footprint=footprint,
    )
    world = replace(world, changes=_changes(file.section("changes"), [box.name for box in world.boxes]))
    file.finish()
    return world


def _wall(section: Section) -> tuple[Wall, list[Box]]:
    points = section.points("points_m")
    pieces = len(points) - 1
    if np.any(np.hypot(*np.diff(points, axis=0).T) < 1e-3):
        raise ConfigError(f"{section.where('points_m')}: points_m holds the same point twice in a row")
    blanks = []
    for entry in section.sections("blanks"):
        blanks.append(Blank(entry.whole("segment", high=pieces - 1), entry.number("from_m", low=0.0),
                            entry.number("to_m", low=0.0)))
        entry.finish()
    wall = Wall(
        name=section.text("name"),
        points_m=points,
        height_m=section.number("height_m", 2.6, low=0.1, high=20.0),
        surface=_surface(section.section("surface"), WALL),
        paintings=section.flag("paintings", True),
        twins=tuple(int(v) for v in section.numbers("twins", (), count=pieces if "twins" in section.nodes else None)),
        blanks=tuple(blanks),
    )
    pilasters = section.section("pilasters")
    boxes = _pilasters(wall, pilasters) if pilasters.nodes else []
    section.finish()
    return wall, boxes


def _pilasters(wall: Wall, section: Section) -> list[Box]:
    """Boxes standing astride the wall every spacing_m, so that a range sensor sees where along it the robot is."""
    spacing = section.number("spacing_m", 3.0, low=0.2, high=100.0)
    width = section.number("width_m", 0.4, low=0.02, high=10.0)
    depth = section.number("depth_m", 0.2, low=0.01, high=5.0)
    section.finish()
    boxes: list[Box] = []
    for a, b in wall.segments_m:
        length, yaw = float(np.hypot(*(b - a))), math.atan2(*(b - a)[::-1])
        count = int(length / spacing)
        for along in (np.arange(count) + 0.5) * length / max(count, 1):
            x, y = a + (b - a) * along / length
            boxes.append(Box(f"{wall.name} pilaster {len(boxes)}", (float(x), float(y)),
                             (width, 2.0 * depth, wall.height_m), yaw, 0.0, wall.surface))
    return boxes


def _box(section: Section) -> Box:
    x, y = _point(section, "centre_m")
    size = section.numbers("size_m", count=3, low=0.01, high=100.0)
    box = Box(
        name=section.text("name"), centre_m=(x, y), size_m=(size[0], size[1], size[2]),
        yaw_rad=float(np.radians(section.number("yaw_deg", 0.0, low=-360.0, high=360.0))),
        bottom_m=section.number("bottom_m", 0.0, low=0.0, high=20.0),
        surface=_surface(section.section("surface"), FURNITURE))
    section.finish()
    return box


def _changes(section: Section, boxes: list[str]) -> Changes:
    """What happens between survey and patrol to boxes of these names, and to the light."""
    removed, moved = section.texts("removed"), section.section("moved")
    for key, name in [("removed", name) for name in removed] + [("moved", name) for name in moved.keys()]:
        if name not in boxes:
            near = difflib.get_close_matches(name, boxes, n=1, cutoff=0.5)
            advice = f"did you mean '{near[0]}'?" if near else f"boxes: {', '.join(boxes) or 'none'}"
            raise ConfigError(f"{section.where(key)}: {key}: no box is named '{name}'; {advice}")
    stands = {name: moved.numbers(name, count=3) for name in moved.keys()}
    moved.finish()
    both = sorted(set(stands) & set(removed))
    if both:
        raise ConfigError(f"{section.where('moved')}: '{both[0]}' is both moved and removed; expected one of the two")
    lamp = section.number("lamp_deg", low=-360.0, high=360.0) if "lamp_deg" in section.nodes else None
    light = Light(section.number("light", 1.0, low=0.05, high=3.0), None if lamp is None else float(np.radians(lamp)))
    section.finish()
    moves = tuple((name, x, y, float(np.radians(yaw))) for name, (x, y, yaw) in stands.items())
    return Changes(tuple(removed), moves, light)


def _point(section: Section, key: str) -> tuple[float, float]:
    x, y = section.numbers(key, count=2, low=-FAR_M, high=FAR_M)
    return x, y


def _surface(section: Section, default: Surface) -> Surface:
    r, g, b = section.numbers("colour", default.colour, count=3, low=0.0, high=255.0)
    surface = Surface(section.text("recipe", default.recipe, choices=RECIPES), (r, g, b),
                      section.number("roughness", default.roughness, low=0.0, high=100.0),
                      section.whole("fold", default.fold, low=1, high=4))
    if surface.fold == 3:
        raise ConfigError(f"{section.where('fold')}: fold=3 is not possible on square tiles; expected 1, 2 or 4")
    section.finish()
    return surface


def _paintings(section: Section) -> Paintings:
    default = Paintings()
    width = section.numbers("width_m", default.width_m, count=2, low=0.05, high=20.0)
    height = section.numbers("height_m", default.height_m, count=2, low=0.05, high=20.0)
    paintings = Paintings(
        unique=section.whole("unique", default.unique, low=1, high=100_000),
        density=section.number("density", default.density, low=0.0, high=1.0),
        spacing_m=section.number("spacing_m", default.spacing_m, low=0.2, high=100.0),
        width_m=(width[0], width[1]), height_m=(height[0], height[1]),
        middle_m=section.number("middle_m", default.middle_m, low=0.0, high=20.0))
    section.finish()
    for name in ("width_m", "height_m"):
        low, high = getattr(paintings, name)
        if low > high:
            raise ConfigError(f"{section.where(name)}: {name}: least {low} is more than greatest {high}")
    return paintings


def reversed_world(world: World) -> World:
    """The same building surveyed the other way: from the end of the route back to its beginning."""
    route = world.route_m[::-1].copy()
    dx, dy = route[1] - route[0]
    return replace(world, route_m=route, start=(float(route[0, 0]), float(route[0, 1]), math.atan2(dy, dx)))
