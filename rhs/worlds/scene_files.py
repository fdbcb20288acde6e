"""Gazebo worlds and models (SDF) and robot descriptions used as buildings (URDF): links with their poses, what is drawn and
what is solid. Written after the SDFormat specification 1.4 to 1.11 (http://sdformat.org/spec) and the ROS wiki's urdf/XML.

`model://NAME` and `package://NAME` are looked up beside the file and above it. What is missing is left out and named. A
link that draws nothing shows what is solid of it. Deviations: joints stand at zero; lights, plugins, sensors and physics are
left. What Gazebo makes of saved states, robots and actors: gazebo.py.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from rhs.api.floorplan import Person
from rhs.api.geometry import se3
from rhs.base.errors import ConfigError

from .gazebo import as_saved, downloaded, fetched, installed, is_robot, person_of
from .mesh_files import Y_UP, MeshFile, check_readable, check_xml, read_mesh
from .sdf_poses import DEEPEST, HOW_XACRO, frame_in, numbers_in, placed_at, pose_of, poses_in, values_of
from .soup import Part, box, cylinder, part, sphere

SCENES = (".world", ".sdf", ".urdf", ".wbt")
MOST_BYTES = 64 << 20
ABOVE = 5  # folders above a file in which models are looked for
BUILT_IN = ("sun", "ground_plane")  # come with Gazebo: a light, and a plane that the floor stands for
NAMED_COLOURS = {"white": (255, 255, 255), "grey": (178, 178, 178), "darkgrey": (74, 74, 74), "black": (20, 20, 20),
                 "red": (255, 0, 0), "green": (0, 255, 0), "blue": (0, 0, 255), "yellow": (255, 255, 0),
                 "orange": (255, 130, 20), "purple": (255, 0, 255), "wood": (160, 115, 70), "bricks": (160, 90, 70),
                 "skyblue": (33, 112, 178), "turquoise": (0, 255, 255), "indigo": (84, 0, 128), "flatblack": (25, 25, 25),
                 "gold": (204, 165, 30), "darkyellow": (178, 178, 0), "paintedwall": (200, 195, 185),
                 "woodfloor": (150, 110, 70), "ceilingtiled": (215, 215, 210), "grass": (90, 120, 60)}
ACTOR_M = (0.2, 1.7)  # radius and height of somebody who stands


@dataclass(eq=False)
class Scene:
    """What was found: parts in place, z up, metres; whether there is a ground plane; the names of what is missing, and of
    the robots, which are left out; who walks."""

    parts: list[Part] = field(default_factory=list)
    ground: bool = False
    missing: list[str] = field(default_factory=list)
    robots: list[str] = field(default_factory=list)
    people: list[Person] = field(default_factory=list)
    meshes: dict[Path, MeshFile | None] = field(default_factory=dict)
    images: dict[Path, np.ndarray | None] = field(default_factory=dict)


def read_scene(path: Path) -> Scene:
    """All of a world, model or robot file. Raises ConfigError in one line."""
    scene = Scene()
    if path.suffix.lower() == ".wbt":
        from .others.webots import read_webots  # which loads scipy

        scene.parts, scene.missing, scene.robots = read_webots(path)
        return _seen(scene, path)
    root = _xml(path)
    if root.tag == "robot":
        _robot(scene, root, path)
    elif root.tag in ("sdf", "gazebo"):
        _children(scene, root, np.eye(4), path, 0)
    else:
        raise ConfigError(f"{path}: the file begins with <{str(root.tag)[:40]}>; expected <sdf> or <robot>")
    return _seen(scene, path)


def _seen(scene: Scene, path: Path) -> Scene:
    """The scene. Raises ConfigError where it holds nothing to see."""
    if not scene.parts:
        left_out = f"; missing: {scene.missing[0]}{fetched(scene.missing)}" if scene.missing else ""
        if "ros.org/wiki/xacro" in path.read_text("utf-8", "replace"):
            raise ConfigError(f"{path}: {HOW_XACRO.format(file=path.name)}")
        raise ConfigError(f"{path}: nothing to see in this file{left_out}")
    return scene


def _xml(path: Path) -> Element:
    check_readable(path, MOST_BYTES)
    text = path.read_bytes()
    check_xml(text, path)
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigError(f"{path}: this XML cannot be read ({' '.join(str(error).split())[:120]})") from error


# --- SDF ----------------------------------------------------------------------------------------------------------------


def _children(scene: Scene, parent: Element, placed: np.ndarray, path: Path, depth: int) -> None:
    """Worlds, models, links and includes of an element; placed (4, 4): where it stands."""
    if depth > DEEPEST:
        raise ConfigError(f"{path}: models include one another more than {DEEPEST} deep; expected no circle")
    if parent.tag == "world":
        as_saved(parent)
    poses = poses_in(scene.missing, parent, path)
    for child in parent:
        if child.tag == "world":
            _children(scene, child, placed, path, depth + 1)
        elif child.tag == "model" and is_robot(child):
            scene.robots.append(child.get("name", "a robot"))
        elif child.tag in ("model", "link"):
            by = child.get("placement_frame", "")
            own = np.linalg.inv(frame_in(scene.missing, child, by, path)) if by else np.eye(4)
            at = placed @ poses.get(id(child), np.eye(4)) @ own @ _scale(child, "scale", path)
            (_link if child.tag == "link" else _children)(scene, child, at, path, depth + 1)
        elif child.tag == "include":
            _include(scene, child, placed @ poses[id(child)] @ _scale(child, "scale", path), path, depth)
        elif child.tag == "actor":
            _actor(scene, child, placed, path)
        elif child.tag == "population":
            scene.missing.append(f"the population {child.get('name', '')}")


def _actor(scene: Scene, actor: Element, placed: np.ndarray, path: Path) -> None:
    """Somebody who walks in the frame of the world, or stands."""
    person = person_of(actor, partial(pose_of, path=path), path)
    if person is not None:
        scene.people.append(person)
        return
    feet = placed @ pose_of(actor, path)
    feet[2, 3] = 0.0
    scene.parts.append(cylinder(*ACTOR_M).moved(feet @ se3(np.eye(3), np.array([0.0, 0.0, 0.5 * ACTOR_M[1]]))))


def _scale(element: Element, key: str, path: Path) -> np.ndarray:
    """(4, 4) of an attribute of three numbers; the identity where there is none."""
    text = element.get(key)
    return np.eye(4) if text is None else np.diag([*values_of(text, 3, key, path), 1.0])


def _include(scene: Scene, element: Element, at: np.ndarray, path: Path, depth: int) -> None:
    uri = (element.findtext("uri") or "").strip()
    name = uri.split("/models/")[-1].removeprefix("model://").strip("/").lower().replace(" ", "_")
    found = _found(uri, path.parent)
    if found is not None and found.is_dir():
        found = _model_file(found)
    if found is None or not found.is_file():
        scene.ground |= name == "ground_plane"
        if name not in BUILT_IN:
            scene.missing.append(uri or "an include without uri")
        return
    root = _xml(found)
    models = root.findall("model")
    posed = models and element.find("pose") is not None  # the include's pose replaces the model's
    own = pose_of(models[0], found) if posed else np.eye(4)
    if models and (by := (element.findtext("placement_frame") or "").strip()):
        own = own @ frame_in(scene.missing, models[0], by, found)
    _children(scene, root, at @ np.linalg.inv(own), found, depth + 1)


def _model_file(folder: Path) -> Path | None:
    """The file of a model's folder: what model.config names last (the newest version), or model.sdf."""
    config = folder / "model.config"
    if (folder / "model.sdf").is_file():
        return folder / "model.sdf"
    if config.is_file():
        names = [(one.text or "").strip() for one in _xml(config).findall("sdf")]
        return next((folder / name for name in reversed(names) if (folder / name).is_file()), None)
    return next(iter(sorted(folder.glob("*.sdf"))), None)


def _link(scene: Scene, link: Element, placed: np.ndarray, path: Path, depth: int) -> None:
    drawn = [one for shape in link.findall("visual") for one in _shape(scene, shape, placed, path)]
    if not drawn:
        drawn = [one for shape in link.findall("collision") for one in _shape(scene, shape, placed, path)]
    scene.parts += drawn


def _shape(scene: Scene, shape: Element, placed: np.ndarray, path: Path) -> Iterator[Part]:
    """A visual or collision of SDF."""
    geometry, at = shape.find("geometry"), placed @ pose_of(shape, path)
    for kind in geometry if geometry is not None else ():
        if kind.tag == "plane":
            scene.ground = True
        elif kind.tag == "box":
            yield from _worn(scene, box(numbers_in(kind, "size", 3, path)), shape, path, at)
        elif kind.tag in ("cylinder", "capsule"):
            radius, length = numbers_in(kind, "radius", 1, path)[0], numbers_in(kind, "length", 1, path)[0]
            yield from _worn(scene, cylinder(radius, length + (2 * radius if kind.tag == "capsule" else 0)), shape, path, at)
        elif kind.tag == "sphere":
            yield from _worn(scene, sphere(numbers_in(kind, "radius", 1, path)[0]), shape, path, at)
        elif kind.tag == "ellipsoid":
            yield from _worn(scene, sphere(1.0), shape, path, at @ np.diag([*numbers_in(kind, "radii", 3, path), 1.0]))
        elif kind.tag == "polyline":
            yield from _worn(scene, _pulled_up(kind, path), shape, path, at)
        elif kind.tag == "mesh":
            scale = np.diag([*(numbers_in(kind, "scale", 3, path) if kind.find("scale") is not None else np.ones(3)), 1.0])
            if (submesh := kind.findtext("submesh/name")) is not None:
                scene.missing.append(f"the submesh {submesh.strip()} alone: all of its mesh is there")
            for one in _mesh(scene, (kind.findtext("uri") or "").strip(), path):
                yield from _worn(scene, one, shape, path, at @ scale)
        elif kind.tag != "empty":
            scene.missing.append(f"<{kind.tag}>")


def _worn(scene: Scene, one: Part, shape: Element, path: Path, at: np.ndarray) -> Iterator[Part]:
    """The part in place, in the colour or the picture of the SDF's material if it has one."""
    material = shape.find("material")
    if material is not None:
        diffuse, ambient = ((material.findtext(key) or "").split() for key in ("diffuse", "ambient"))
        script = NAMED_COLOURS.get((material.findtext("script/name") or "").removeprefix("Gazebo/").lower())
        light = diffuse if len(diffuse) >= 3 else ambient
        if script is not None and len(diffuse) < 3:  # the building editor tints what a script paints by <ambient>
            tint = np.array(_colour(ambient, path) if len(ambient) >= 3 else (255, 255, 255)) / 255.0
            r, g, b = (tint * script).astype(int).tolist()
            one = one.coloured((r, g, b))
        elif len(light) >= 3:
            one = one.coloured(_colour(light, path))
        picture = (material.findtext("pbr/metal/albedo_map") or material.findtext("pbr/specular/albedo_map") or "").strip()
        image = _image(scene, picture, path) if picture else None
        one = one if image is None else one.wearing(image)
    yield one.moved(at)


def _pulled_up(kind: Element, path: Path) -> Part:
    """A polyline of SDF: its sides and its lid, as a fan (right for convex ones)."""
    points = np.array([values_of(point.text, 2, "point", path) for point in kind.findall("point")]).reshape(-1, 2)
    if len(points) < 3:
        raise ConfigError(f"{path}: a <polyline> has {len(points)} points; expected at least 3")
    height = numbers_in(kind, "height", 1, path)[0]
    low, high = (np.column_stack([points, np.full(len(points), z)]) for z in (0.0, height))
    after = np.roll(np.arange(len(points)), -1)
    sides = [np.stack([low, low[after], high[after]], axis=1), np.stack([low, high[after], high], axis=1)]
    lid = np.stack([np.broadcast_to(high[0], (len(points) - 2, 3)), high[1:-1], high[2:]], axis=1)
    return part(np.concatenate([*sides, lid]))


# --- URDF ---------------------------------------------------------------------------------------------------------------


def _robot(scene: Scene, robot: Element, path: Path) -> None:
    """All links of a URDF, joints at zero."""
    links = {link.get("name", ""): link for link in robot.findall("link")}
    above = {_name(joint, "child"): (_name(joint, "parent"), _origin(joint, path)) for joint in robot.findall("joint")}
    colours = {m.get("name"): m.find("color").get("rgba", "") for m in robot.iter("material")  # type: ignore[union-attr]
               if m.find("color") is not None}
    for name, link in links.items():
        placed, at, steps = np.eye(4), name, 0
        while at in above and steps <= len(links):
            at, origin = above[at]
            placed, steps = origin @ placed, steps + 1
        shapes = link.findall("visual") or link.findall("collision")
        for shape in shapes:
            material = shape.find("material")
            rgba = "" if material is None else colours.get(material.get("name")) or ""
            for one in _urdf_shape(scene, shape, path):
                one = one.coloured(_colour(rgba.split(), path)) if len(rgba.split()) >= 3 and one.image is None else one
                scene.parts.append(one.moved(placed @ _origin(shape, path)))


def _name(joint: Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _urdf_shape(scene: Scene, shape: Element, path: Path) -> Iterator[Part]:
    geometry = shape.find("geometry")
    for kind in geometry if geometry is not None else ():
        if kind.tag == "box":
            yield box(values_of(kind.get("size"), 3, "size", path))
        elif kind.tag in ("cylinder", "capsule"):
            radius, length = (values_of(kind.get(key), 1, key, path)[0] for key in ("radius", "length"))
            yield cylinder(radius, length + (2 * radius if kind.tag == "capsule" else 0.0))
        elif kind.tag == "sphere":
            yield sphere(values_of(kind.get("radius"), 1, "radius", path)[0])
        elif kind.tag == "mesh":
            scale = np.diag([*values_of(kind.get("scale", "1 1 1"), 3, "scale", path), 1.0])
            yield from (one.moved(scale) for one in _mesh(scene, kind.get("filename", ""), path))


def _origin(element: Element, path: Path) -> np.ndarray:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz, rpy = (values_of(origin.get(key, "0 0 0"), 3, key, path) for key in ("xyz", "rpy"))
    return placed_at(xyz, rpy)


# --- both ---------------------------------------------------------------------------------------------------------------


def _mesh(scene: Scene, uri: str, path: Path) -> tuple[Part, ...]:
    """Parts of a mesh file, in metres; none, and its name among the missing, where it is not there or cannot be read."""
    found = _found(uri, path.parent)
    if found is None:
        scene.missing.append(uri or "a mesh without uri")
        return ()
    if found not in scene.meshes:
        try:
            scene.meshes[found] = read_mesh(found)
        except ConfigError as error:
            if "rhs[buildings]" in str(error):
                raise
            scene.meshes[found] = None
            scene.missing.append(found.name)
    mesh = scene.meshes[found]
    if mesh is None:
        return ()
    scene.missing += [name for name in mesh.missing if name not in scene.missing]
    upright = Y_UP if found.suffix.lower() in (".glb", ".gltf") else np.eye(4)  # Gazebo takes COLLADA's axes as they are
    return tuple(one.moved(upright @ np.diag([*[mesh.unit_m or 1.0] * 3, 1.0])) for one in mesh.parts)


def _image(scene: Scene, uri: str, path: Path) -> np.ndarray | None:
    import cv2

    found = _found(uri, path.parent)
    if found is None:
        scene.missing.append(uri)
        return None
    if found not in scene.images:
        image = cv2.imread(str(found), cv2.IMREAD_COLOR)
        scene.images[found] = None if image is None else np.ascontiguousarray(image[..., ::-1])
    return scene.images[found]


def _found(uri: str, folder: Path) -> Path | None:
    """The file or folder that a uri names: model:// and package:// beside the file and above it, then where Gazebo would
    look; Fuel's among those downloaded; else from the file's folder."""
    versions: list[Path] = []
    if uri.startswith(("https://", "http://")):
        name, versions = downloaded(uri)
        uri = f"model://{name}"
    for scheme in ("model://", "package://", "file://"):
        if uri.startswith(scheme):
            name = uri.removeprefix(scheme)
            break
    else:
        scheme, name = "", uri
    if not name:
        return None
    places = [folder / name]
    if scheme in ("model://", "package://"):
        for above in [folder, *folder.parents][:ABOVE]:
            places += [above / name, above / "models" / name, above / "meshes" / name]
            if above.name == name.split("/")[0]:
                places.append(above.parent / name)
        places += [*installed(name), *versions]
    return next((place.resolve() for place in places if place.exists()), None)


def _colour(words: list[str], path: Path) -> tuple[int, int, int]:
    r, g, b = np.clip(255.0 * values_of(" ".join(words[:3]), 3, "colour", path), 0, 255).astype(int).tolist()
    return r, g, b
