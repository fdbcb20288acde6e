"""Worlds of Webots (.wbt): what stands in them as plain nodes of VRML, and the walls, windows, shut doors and arenas of its
own library, whose sizes are in the world. All other objects of a library (PROTO) lie in other files: they are left out and
named. Written after the Webots reference manual (cyberbotics.com/doc/reference) and the heads of its PROTO files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rhs.api.geometry import se3
from rhs.base.errors import ConfigError

from ..mesh_files import Y_UP, check_readable
from ..soup import Part, box
from ..vrml import DEEPEST, MOST_NODES, SWAP, Node, Reader, parent_from_child, shape_of
from ..vrml import Scene as Shapes

MOST_BYTES = 64 << 20
HEAD = re.compile(r"#VRML_SIM\s+[RV](\d+)")
OTHER_FILES = re.compile(r'^\s*(?:IMPORTABLE\s+)?EXTERNPROTO\s+"[^"\n]*"|\bhidden\s+(?=\w)', re.M)
Z_UP_SINCE = 2022  # the year of the version from which on z is up where WorldInfo says nothing
UNSEEN = re.compile(r".*(Light|Background|Physics)|WorldInfo|Viewpoint|Fog|Floor|Carpet")  # Floor: the ground, z = 0
STANDING = ("Wall", "Window", "Door")  # their origin is on the floor
PLAIN = ("Solid", "Transform", "Pose", "Group", "Door")
GRID = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # heights along z in place of y


@dataclass
class World:
    """parts: in place, z up, metres. missing: what is left out. robots: names of robots, which are left out."""

    shapes: Shapes
    z_up: bool
    robots: list[str] = field(default_factory=list)


def read_webots(path: Path) -> tuple[list[Part], list[str], list[str]]:
    """(parts with z up, names of what is left out, names of robots). Raises ConfigError in one line."""
    check_readable(path, MOST_BYTES)
    text = path.read_bytes().decode("utf-8", errors="replace")
    head = HEAD.match(text)
    if head is None:
        raise ConfigError(f"{path}: the file begins with {text[:16].strip()!r}; expected '#VRML_SIM R2023b utf8'")
    try:
        nodes = Reader(OTHER_FILES.sub(" ", text)).nodes()
        info = next((node for node in nodes if node.kind == "WorldInfo"), Node(""))
        newer = int(head[1]) >= Z_UP_SINCE
        world = World(Shapes(path), (info.words("coordinateSystem") or ["ENU" if newer else "NUE"])[0] == "ENU")
        for node in nodes:
            _visit(node, np.eye(4) if world.z_up else Y_UP, world, 0)
    except (ValueError, IndexError, RecursionError) as error:
        raise ConfigError(f"{path}: this world of Webots cannot be read ({error})") from error
    return world.shapes.parts, world.shapes.missing, world.robots


def _visit(node: Node, matrix: np.ndarray, world: World, depth: int) -> None:
    """The shapes of a node and of all below it. matrix: world_from_node."""
    world.shapes.visited += 1
    if depth > DEEPEST or world.shapes.visited > MOST_NODES:
        raise ValueError("more nodes in one another, or in all, than are read")
    if UNSEEN.fullmatch(node.kind):
        return
    if node.kind == "Shape":
        world.shapes.parts += [one.moved(matrix) for one in _shape(node, world)]
        return
    if node.kind == "Robot" or "controller" in node.fields:
        world.robots.append((node.words("name") or [node.kind])[0])
        return
    matrix = matrix @ parent_from_child(node)
    below = [child for name in ("children", "endPoint") for child in node.nodes(name)]
    known = [*_library(node, z_up=world.z_up)]
    world.shapes.parts += [one.moved(matrix) for one in known]
    if not below and not known and node.kind not in PLAIN and (depth == 0 or "translation" in node.fields):
        world.shapes.missing.append(node.kind)
    for child in below:
        _visit(child, matrix, world, depth + 1)


def _shape(node: Node, world: World) -> list[Part]:
    """Of a Shape; level planes are floors and ceilings, which are there without them."""
    geometry = node.node("geometry")
    if geometry is None or geometry.kind == "Plane":
        return []
    found = shape_of(node, world.shapes)
    if world.z_up and geometry.kind in ("Cylinder", "Cone"):
        return [one.moved(SWAP.T) for one in found]
    return [one.moved(GRID) for one in found] if world.z_up and geometry.kind == "ElevationGrid" else found


def _library(node: Node, *, z_up: bool) -> Iterator[Part]:
    """What Webots' own PROTO of that name is made of, in its frame. A door that can be opened is open."""
    up = 2 if z_up else 1
    if node.kind in STANDING and (node.kind != "Door" or not node.yes("canBeOpen", default=True)):
        size = node.numbers("size", (0.2, 1.0, 2.4) if z_up else (1.0, 2.4, 0.2), width=3)[0]
        yield box(size).moved(se3(np.eye(3), 0.5 * size * (np.arange(3) == up)))
    elif node.kind == "SolidBox":
        yield box(node.numbers("size", (1.0, 1.0, 1.0), width=3)[0])
    elif node.kind == "RectangleArena":
        across = node.numbers("floorSize", (1.0, 1.0))
        thick, high = (float(node.numbers(name, (m,))[0]) for name, m in (("wallThickness", 0.01), ("wallHeight", 0.1)))
        for axis in (0, 1):
            size, away = across + 2 * thick * (np.arange(2) != axis), np.zeros(2)
            size[axis], away[axis] = thick, 0.5 * (across[axis] + thick)
            for side in (away, -away):
                yield box(np.insert(size, up, high)).moved(se3(np.eye(3), np.insert(side, up, 0.5 * high)))
