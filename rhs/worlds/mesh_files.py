"""Mesh files of other programs: OBJ, glTF, STL, COLLADA, PLY and OFF, read by trimesh (MIT) and, for COLLADA, pycollada
(BSD), the extra `buildings` of this package; VRML97, read by vrml.py."""

from __future__ import annotations

import importlib.util
import io
import json
import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from rhs.base.commands import check_regular, check_whole
from rhs.base.errors import ConfigError

from .soup import MOST_TRIANGLES, Part, part

MESHES = (".obj", ".glb", ".gltf", ".stl", ".dae", ".ply", ".off", ".wrl")
MOST_BYTES = 512 << 20
PACKED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing")  # of glTF
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # z_up_from_y_up


@dataclass(frozen=True, eq=False)
class MeshFile:
    """parts: as they stand in the file. unit_m: metres of its unit, None where the format does not say. up: `y` or `z`, None
    where the format does not say. missing: names of pictures that could not be read."""

    parts: tuple[Part, ...]
    unit_m: float | None
    up: str | None
    missing: tuple[str, ...]


def read_mesh(path: Path) -> MeshFile:
    """All triangles of a mesh file, each where its scene puts it. Raises ConfigError in one line, whatever is wrong."""
    check_readable(path)
    if path.suffix.lower() == ".wrl":
        from .vrml import read_vrml

        return _whole(path, *read_vrml(path), None, "y")  # many programs write their own unit
    if importlib.util.find_spec("trimesh") is None:
        raise ConfigError(f"meshes need packages that are not installed; type: pip install 'rhs[buildings]' (for {path})")
    unit_m, up = _conventions(path)
    _check_packed(path)
    try:
        parts, missing = _parts(path)
    except ConfigError:
        raise
    except ImportError as error:  # trimesh guesses at an encoding where text or numbers were expected
        kind = path.suffix[1:].upper()
        raise ConfigError(f"{path}: found {path.stat().st_size} bytes that are no whole {kind} file (cut off?)") from error
    except Exception as error:  # trimesh and its parsers raise anything about a broken file
        said = " ".join(str(error).split())[:120] or type(error).__name__
        raise ConfigError(f"{path}: trimesh cannot read this mesh ({said})") from error
    return _whole(path, parts, missing, unit_m, up)


def _whole(path: Path, parts: list[Part], missing: list[str], unit_m: float | None, up: str | None) -> MeshFile:
    if not parts:
        raise ConfigError(f"{path}: no triangles in this file, only points at most; make faces of them (MeshLab: screened "
                          "Poisson), or a map: octomap_server or pcd2pgm")
    return MeshFile(tuple(parts), unit_m, up, tuple(missing))


def check_readable(path: Path, most_bytes: int = MOST_BYTES) -> None:
    """Refuse what is no file, or too large."""
    if not path.is_file():
        raise ConfigError(f"{path}: there is no such file")
    check_regular(path)
    check_whole(path)
    if path.stat().st_size > most_bytes:
        raise ConfigError(f"{path}: {path.stat().st_size >> 20} MB are more than the {most_bytes >> 20} MB allowed")


def check_xml(text: bytes, path: Path) -> None:
    """Refuse XML that defines entities: a small file could ask for all the memory there is, or for other files."""
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise ConfigError(f"{path}: this XML has a DOCTYPE or ENTITY, which is not read; take that line out")


def _conventions(path: Path) -> tuple[float | None, str | None]:
    """Metres a unit and the axis that points up, as the format or the file says."""
    kind = path.suffix.lower()
    if kind in (".glb", ".gltf"):
        return 1.0, "y"  # glTF 2.0, section 3.4
    if kind != ".dae":
        return None, None
    text = path.read_bytes()
    check_xml(text, path)
    unit = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([0-9.eE+-]+)[\"']", text)
    axis = re.search(rb"<up_axis>\s*([XYZ])_UP", text)
    return (float(unit[1]) if unit else 1.0), (axis[1].decode().lower() if axis else "y")  # COLLADA 1.5: defaults


def _check_packed(path: Path) -> None:
    """Refuse a glTF whose points are packed in a way that trimesh does not unpack: it would read others, without a word."""
    if path.suffix.lower() not in (".glb", ".gltf"):
        return
    data = path.read_bytes()
    if data[:4] == b"glTF":  # glTF 2.0, section 4.4: a head of 12 bytes, then the chunk of JSON with its length
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    try:
        plain = json.loads(data)
        used = {name for name in plain.get("extensionsUsed", ()) if name in PACKED}
        points = {one["attributes"]["POSITION"] for mesh in plain.get("meshes", ()) for one in mesh["primitives"]}
        if any(plain["accessors"][k].get("normalized") for k in points):
            used.add("normalized POSITION")
    except (ValueError, KeyError, TypeError, IndexError, AttributeError):
        return  # trimesh says what is wrong
    if used:
        raise ConfigError(f"{path}: its points are packed ({', '.join(sorted(used))}); export it again without "
                          "compression (Blender reads Draco's)")


def _parts(path: Path) -> tuple[list[Part], list[str]]:
    """The parts of a file and the names of the files it wants in vain."""
    import trimesh

    wanted = _resolver(path)
    log = logging.getLogger("trimesh")
    before = log.level
    log.setLevel(logging.CRITICAL)  # what it says of broken files is said better below
    try:
        with io.BytesIO(from_one(path.read_bytes())) if path.suffix.lower() == ".obj" else path.open("rb") as file:
            scene = trimesh.load_scene(file, file_type=path.suffix[1:].lower(), resolver=wanted, process=False)
    finally:
        log.setLevel(before)
    parts: list[Part] = []
    total = 0
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or not len(geometry.faces):
            continue
        total += len(geometry.faces)
        if total > MOST_TRIANGLES:
            raise ConfigError(f"{path}: more than {MOST_TRIANGLES} triangles; make the mesh coarser")
        parts.append(_part(geometry).moved(np.asarray(matrix, float)))
    return parts, wanted.missing


def from_one(text: bytes) -> bytes:
    """An OBJ whose faces count its vertices from 1: those that count back from the last one so far are written anew, as
    trimesh takes them to count back from the last of the file."""
    if not re.search(rb"^\s*f\b.*[\s/]-\d", text, re.MULTILINE):
        return text
    so_far, out = {b"v": 0, b"vt": 0, b"vn": 0}, []

    def counted(corner: bytes) -> bytes:
        numbers = zip(corner.split(b"/"), so_far.values(), strict=False)
        return b"/".join(b"%d" % (total + 1 + int(number)) if number.startswith(b"-") else number
                         for number, total in numbers)

    for line in text.splitlines():
        word, *rest = line.split() or [b""]
        if word in so_far:
            so_far[word] += 1
        out.append(b" ".join([word, *map(counted, rest)]) if word == b"f" else line)
    return b"\n".join(out)


def _resolver(path: Path) -> Any:
    """What finds the pictures and materials that a mesh names: beside it, in textures/ or ../textures, or in
    ../materials/textures as Gazebo does."""
    from trimesh.resolvers import FilePathResolver

    class Beside(FilePathResolver):
        missing: list[str] = []

        def get(self, name: str) -> bytes:
            plain = unquote(str(name).strip().removeprefix("file://")).replace("\\", "/")
            last = plain.rsplit("/", 1)[-1]
            folder = path.parent
            inner = (folder / name / last for name in ("textures", "Textures", "../textures", "../materials/textures"))
            for place in (folder / plain, folder / last, *inner):
                if last and place.is_file():
                    return place.read_bytes()
            self.missing.append(last or "a file without a name")
            raise ConfigError(f"{path}: {plain} is not there")

    return Beside(str(path))


def _part(geometry: Any) -> Part:
    """A part from one trimesh.Trimesh with whatever it wears."""
    corners = np.asarray(geometry.vertices, float)[geometry.faces]
    visual = geometry.visual
    if visual.kind != "texture":
        out = part(corners)
        if visual.kind in ("face", "vertex"):
            colours = np.asarray(visual.face_colors)[:, :3]
            out = Part(corners, colours.astype(np.uint8))
        return out
    whole = visual.uv is not None and len(visual.uv) == len(geometry.vertices)
    uv = np.asarray(visual.uv, float)[geometry.faces] if whole else None
    image, colour = _material(visual.material)
    out = part(corners, uv)
    out = out if colour is None else out.coloured(colour)
    return out if image is None or uv is None else out.wearing(image)


def _material(material: Any) -> tuple[np.ndarray | None, tuple[int, int, int] | None]:
    """Picture (H, W, 3) and colour of a material of trimesh; None where it has none."""
    picture = getattr(material, "baseColorTexture", None)
    picture = getattr(material, "image", None) if picture is None else picture
    colour = getattr(material, "baseColorFactor", None)
    colour = getattr(material, "diffuse", None) if colour is None else colour
    if colour is not None:
        values = np.asarray(colour, float).ravel()[:3]
        scale = 1.0 if np.asarray(colour).dtype.kind in "ui" else 255.0
        colour = tuple(int(v) for v in np.clip(values * scale, 0, 255)) if len(values) == 3 else None
    return (None if picture is None else np.asarray(picture.convert("RGB"))), colour
