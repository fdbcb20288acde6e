"""VRML97 (.wrl, ISO/IEC 14772-1:1997), what CAD programs and old robot simulators write: parts of a building with colours
and pictures. Read here because the one kept library that reads it (VTK) is 130 MB, and a broken file ends its process.

Read are Transform, Group and other nodes with children, Switch, LOD (the finest), Inline, DEF and USE; Box, Cylinder, Cone,
Sphere, IndexedFaceSet and ElevationGrid; the diffuse colour of a Material, colours of faces or corners, and ImageTexture.
What else may have a shape (Extrusion, Text) is left out and named, a PROTO is refused. y is up (section 4.4.5)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rhs.api.geometry import se3
from rhs.base.errors import ConfigError

from .soup import GREY, MOST_TRIANGLES, Part, box, cylinder, part, sphere
from .triangulate import triangulated

TOKEN = re.compile(r'\s*(?:"((?:\\.|[^"\\])*)"|([{}\[\]])|([^\s{}\[\]"]+))')
NUMBERS = re.compile(r"[^\]\[{}\"]*")
SPACE = re.compile(r'("(?:\\.|[^"\\])*")|#[^\n]*|,')  # strings are kept, comments and commas are space
NUMBER = re.compile(r"[+-]?(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)")
SWAP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # y_up_from_z_up, for shapes made upright in z
LINES = {"PointSet", "IndexedLineSet"}  # nothing that hides what is behind
DEEPEST = 200  # nodes in one another; more are a loop or a trap
MOST_NODES = 300_000  # on the way through a scene: a small file can use a node in a node in a node


@dataclass
class Node:
    """A node with its fields: numbers (array), words (list of str), nodes (list)."""

    kind: str
    fields: dict[str, Any] = field(default_factory=dict)

    def numbers(self, name: str, default: tuple[float, ...] = (), *, width: int = 1) -> np.ndarray:
        """A field of numbers, (N, width) where width is more than 1. Raises ValueError."""
        values = np.asarray(self.fields.get(name, default), float).ravel()
        if len(values) % width:
            raise ValueError(f"{self.kind} {name} has {len(values)} numbers; expected threes" if width == 3 else
                             f"{self.kind} {name} has {len(values)} numbers; expected a multiple of {width}")
        return values.reshape(-1, width) if width > 1 else values

    def nodes(self, name: str) -> list[Node]:
        """The nodes in a field."""
        return [one for one in self.fields.get(name, ()) if isinstance(one, Node)]

    def node(self, name: str) -> Node | None:
        """The node in a field, if there is one."""
        return next(iter(self.nodes(name)), None)

    def words(self, name: str) -> list[str]:
        """Strings and words of a field."""
        return [one for one in self.fields.get(name, ()) if isinstance(one, str)]

    def yes(self, name: str, *, default: bool) -> bool:
        """A field that is TRUE or FALSE."""
        return (self.words(name) or [str(default).upper()])[0] == "TRUE"


class Reader:
    """Nodes of a text. Raises ValueError where it is broken."""

    def __init__(self, text: str) -> None:
        self.text = SPACE.sub(lambda found: found[1] or " ", text)
        self.at = 0
        self.named: dict[str, Node] = {}

    def nodes(self, closing: str = "") -> list[Node]:
        """All nodes up to the closing bracket, or to the end."""
        return [one for one in self._values(closing, 0) if isinstance(one, Node)]

    def _next(self) -> tuple[str, str]:
        """(kind, text) of the next token: `text` a string, `mark` a bracket, `word`; kind is empty at the end."""
        found = TOKEN.match(self.text, self.at)
        if not found:
            return "", ""
        self.at = found.end()
        return next((kind, text) for kind, text in zip(("text", "mark", "word"), found.groups(), strict=True)
                    if text is not None)

    def _values(self, closing: str, depth: int) -> Iterator[Any]:
        while True:
            kind, text = self._next()
            if kind == "" and closing:
                raise ValueError(f"it ends within {closing}")
            if kind == "" or (kind == "mark" and text == closing):
                return
            if kind == "mark":
                raise ValueError(f"{text} stands where a node or a value is expected")
            yield text if kind == "text" else self._node(text, depth)

    def _node(self, word: str, depth: int) -> Any:
        """The node, number or word that begins with a word."""
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} nodes in one another")
        if word in ("PROTO", "EXTERNPROTO"):
            raise ValueError(f"{word}: nodes that a file defines are not read; write it with plain nodes")
        if word == "ROUTE":
            for _ in range(3):
                self._next()
            return word
        if word == "USE":
            name = self._next()[1]
            if name not in self.named:
                raise ValueError(f"USE {name}: nothing of that name was defined before")
            return self.named[name]
        name = ""
        if word == "DEF":
            name, word = self._next()[1], self._next()[1]
        before = self.at
        if self._next() != ("mark", "{"):
            self.at = before
            return float(word) if NUMBER.fullmatch(word) else word
        node = Node(word)
        if name:
            self.named[name] = node
        while (token := self._next()) != ("mark", "}"):
            if token[0] != "word":
                raise ValueError(f"{word}: found {token[1] or 'the end'!r}; expected the name of a field, or }}")
            if token[1] in ("ROUTE", "PROTO", "EXTERNPROTO"):
                self._node(token[1], depth + 1)
                continue
            node.fields[token[1]] = self._field(depth + 1)
        return node

    def _field(self, depth: int) -> Any:
        """The value of a field: what stands in square brackets, a node, or numbers and words up to the next field."""
        before = self.at
        kind, text = self._next()
        if (kind, text) == ("mark", "["):
            numbers = NUMBERS.match(self.text, self.at)
            if numbers and self.text[numbers.end():numbers.end() + 1] == "]":
                try:
                    values = np.array(numbers[0].split(), float)
                    self.at = numbers.end() + 1
                    return values
                except ValueError:
                    pass  # words among them: token by token
            return list(self._values("]", depth))
        values_: list[Any] = []
        while kind == "text" or (kind == "word" and (NUMBER.fullmatch(text) or text in ("TRUE", "FALSE", "NULL"))):
            values_.append(float(text) if kind == "word" and NUMBER.fullmatch(text) else text)
            before = self.at
            kind, text = self._next()
        if values_:
            self.at = before
            return values_
        if kind != "word":
            raise ValueError(f"found {text or 'the end'!r}; expected the value of a field")
        return [self._node(text, depth)]


@dataclass
class Scene:
    """What was found on the way through the nodes."""

    path: Path
    parts: list[Part] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    pictures: dict[str, np.ndarray | None] = field(default_factory=dict)
    shapes: dict[int, list[Part]] = field(default_factory=dict)  # of nodes that may be used again
    visited: int = 0
    triangles: int = 0


def read_vrml(path: Path, *, inlined: int = 0) -> tuple[list[Part], list[str]]:
    """(parts as they stand in the file, names of what is missing or left out). Raises ConfigError in one line."""
    text = path.read_bytes().decode("utf-8", errors="replace")
    if not text.startswith("#VRML V2.0"):
        found = text[:16].split("\n")[0].strip()
        raise ConfigError(f"{path}: the file begins with {found!r}; expected '#VRML V2.0 utf8' (version 1.0 is not read: "
                          "let the program that wrote it write VRML97, or glTF)")
    scene = Scene(path)
    try:
        for node in Reader(text).nodes():
            _visit(node, np.eye(4), scene, inlined, 0)
    except (ValueError, IndexError, RecursionError) as error:
        raise ConfigError(f"{path}: this VRML cannot be read ({error})") from error
    return scene.parts, scene.missing


def _visit(node: Node, matrix: np.ndarray, scene: Scene, inlined: int, depth: int) -> None:
    """The shapes of a node and of all below it. matrix: file_from_node."""
    if depth > DEEPEST:
        raise ValueError(f"more than {DEEPEST} nodes in one another: one holds itself")
    scene.visited += 1
    if scene.visited > MOST_NODES:
        raise ValueError(f"more than {MOST_NODES} nodes")
    if node.kind == "Shape":
        if id(node) not in scene.shapes:
            scene.shapes[id(node)] = shape_of(node, scene)
        found = scene.shapes[id(node)]
        scene.triangles += sum(len(one.corners_m) for one in found)
        if scene.triangles > MOST_TRIANGLES:
            raise ValueError(f"more than {MOST_TRIANGLES} triangles; make the mesh coarser")
        scene.parts += [one.moved(matrix) for one in found]
        return
    if node.kind == "Inline":
        _inline(node, matrix, scene, inlined)
        return
    below = node.nodes("children")
    if node.kind == "Transform":
        matrix = matrix @ parent_from_child(node)
    elif node.kind == "Switch":
        which, choices = int(node.numbers("whichChoice", (-1.0,))[0]), node.nodes("choice")
        below = choices[which:which + 1] if which >= 0 else []
    elif node.kind == "LOD":
        below = node.nodes("level")[:1]
    for child in below:
        _visit(child, matrix, scene, inlined, depth + 1)


def _inline(node: Node, matrix: np.ndarray, scene: Scene, inlined: int) -> None:
    """What stands in another file beside this one."""
    for url in node.words("url"):
        found = scene.path.parent / url
        if found.suffix.lower() == ".wrl" and found.is_file() and inlined < 8:
            parts, missing = read_vrml(found, inlined=inlined + 1)
            scene.parts += [one.moved(matrix) for one in parts]
            scene.missing += missing
            return
    scene.missing.append((node.words("url") or ["an Inline without url"])[0])


def parent_from_child(node: Node) -> np.ndarray:
    """parent_from_child of a Transform: T C R SR S -SR -C (section 6.52)."""
    def shift(name: str, sign: float = 1.0) -> np.ndarray:
        return se3(np.eye(3), sign * node.numbers(name, (0.0, 0.0, 0.0), width=3)[0])

    def turn(name: str, sign: float = 1.0) -> np.ndarray:
        *axis, angle = node.numbers(name, (0.0, 0.0, 1.0, 0.0), width=4)[0]
        length = float(np.linalg.norm(axis)) or 1.0
        return se3(Rotation.from_rotvec(sign * angle / length * np.array(axis)).as_matrix(), np.zeros(3))

    scale = np.diag([*node.numbers("scale", (1.0, 1.0, 1.0), width=3)[0], 1.0])
    centred = turn("rotation") @ turn("scaleOrientation") @ scale @ turn("scaleOrientation", -1.0)
    out: np.ndarray = shift("translation") @ shift("center") @ centred @ shift("center", -1.0)
    return out


def shape_of(node: Node, scene: Scene) -> list[Part]:
    """The parts of a Shape: its geometry in what its appearance says."""
    geometry, appearance = node.node("geometry"), node.node("appearance")
    if geometry is None:
        return []
    found = _geometry(geometry, scene)
    if found is None:
        return []
    material = appearance.node("material") if appearance else None
    if material is not None and (found.colours == GREY).all():
        found = found.coloured(_rgb(material.numbers("diffuseColor", (0.8, 0.8, 0.8)))[0])
    elif appearance is not None and appearance.kind == "PBRAppearance":  # of Webots
        found = found.coloured(_rgb(appearance.numbers("baseColor", (1.0, 1.0, 1.0)))[0])
    texture = appearance.node("texture") or appearance.node("baseColorMap") if appearance else None
    image = _picture(texture, scene) if texture is not None and texture.kind == "ImageTexture" else None
    return [found if image is None else found.wearing(image)]


def _geometry(node: Node, scene: Scene) -> Part | None:
    """The triangles of a geometry node; None, and its kind among what is left out, where it is not read."""
    if node.kind == "Box":
        return box(node.numbers("size", (2.0, 2.0, 2.0), width=3)[0])
    if node.kind == "Sphere":
        return sphere(float(node.numbers("radius", (1.0,))[0]))
    if node.kind in ("Cylinder", "Cone"):
        radius, top = ("bottomRadius", 0.0) if node.kind == "Cone" else ("radius", 1.0)
        return cylinder(float(node.numbers(radius, (1.0,))[0]), float(node.numbers("height", (2.0,))[0]), top).moved(SWAP)
    if node.kind == "IndexedFaceSet":
        return _faces(node)
    if node.kind == "ElevationGrid":
        return _elevation(node)
    if node.kind not in LINES:
        scene.missing.append(node.kind)
    return None


def _elevation(node: Node) -> Part:
    """Two triangles between every four neighbouring heights (section 6.17)."""
    columns, rows = (int(node.numbers(name, (0.0,))[0]) for name in ("xDimension", "zDimension"))
    x, z = (float(node.numbers(name, (1.0,))[0]) for name in ("xSpacing", "zSpacing"))
    heights = node.numbers("height")
    if columns < 2 or rows < 2 or len(heights) != columns * rows:
        raise ValueError(f"ElevationGrid of {columns} x {rows} has {len(heights)} heights")
    across, along = np.meshgrid(x * np.arange(columns), z * np.arange(rows))
    grid = np.stack([across, heights.reshape(rows, columns), along], axis=-1)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    return part(quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3))


def _faces(node: Node) -> Part:
    """The triangles of an IndexedFaceSet (section 6.23): corners, texture corners, colours by face or by corner."""
    coord = node.node("coord")
    points = coord.numbers("point", width=3) if coord else np.zeros((0, 3))
    index = node.numbers("coordIndex").astype(int)
    if len(index) and not -1 <= index.min() <= index.max() < len(points):
        raise ValueError(f"coordIndex asks for point {index.max()} of {len(points)}")
    slots, face = triangulated(points, index, convex=node.yes("convex", default=True))
    texture = node.node("texCoord")
    uv = None
    if texture is not None:
        corners = texture.numbers("point", width=2)
        uv = corners[_of(node, "texCoordIndex", index)[slots]]
    out = part(points[index[slots]], uv)
    colour = node.node("color")
    if colour is None:
        return out
    colours = _rgb(colour.numbers("color"))
    if node.yes("colorPerVertex", default=True):
        worn = np.array(colours, float)[_of(node, "colorIndex", index)[slots]].mean(axis=1)
    else:
        by_face = node.numbers("colorIndex").astype(int)
        worn = np.array(colours, float)[by_face[face] if len(by_face) else face]
    return Part(out.corners_m, worn.astype(np.uint8), out.uv)


def _of(node: Node, name: str, index: np.ndarray) -> np.ndarray:
    """An index field that may be left out: then it is the one of the corners."""
    own = node.numbers(name).astype(int)
    if not len(own):
        return index
    if len(own) < len(index):
        raise ValueError(f"{name} has {len(own)} entries where coordIndex has {len(index)}")
    return own


def _rgb(values: np.ndarray) -> list[tuple[int, int, int]]:
    """Colours as they are worn, 0 to 255."""
    scaled = np.clip(np.asarray(values, float).reshape(-1, 3) * 255.0, 0, 255).astype(int)
    return [(int(r), int(g), int(b)) for r, g, b in scaled]


def _picture(node: Node, scene: Scene) -> np.ndarray | None:
    """The first picture of an ImageTexture that is there and can be read (H, W, 3); else its name is among the missing."""
    import cv2

    names = node.words("url")
    for name in names:
        if name not in scene.pictures:
            found = scene.path.parent / name.replace("\\", "/")
            picture = cv2.imread(str(found), cv2.IMREAD_COLOR_RGB) if found.is_file() else None
            scene.pictures[name] = picture
        if scene.pictures[name] is not None:
            return scene.pictures[name]
    scene.missing += names[:1]
    return None
