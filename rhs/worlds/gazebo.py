"""What a Gazebo world file says beside the shapes of its models: where they stood when it was saved, which of them are
robots, and who walks. Written after the SDFormat specification (http://sdformat.org/spec: state, actor) and what Gazebo
Classic does with it: models are put where the first <state> says, whatever their own pose.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from rhs.api.floorplan import Person
from rhs.base.errors import ConfigError

from .sdf_poses import name_of

DRIVES = re.compile(r"(diff|differential|tricycle|omni)_?drive|planar_?move|mecanum|skid_?steer|ackermann|turtlebot")
SAME_M, CLOSED_M = 1e-3, 0.1  # two waypoints at one spot; a path whose ends are so near is closed
SLOWEST_MPS, FASTEST_MPS = 0.05, 3.0
LONGEST_S = 1e6
MODEL_PATHS = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")


def as_saved(world: Element) -> None:
    """Puts the poses and scales of <state> in the place of those of the world's models."""
    state = world.find("state")
    if state is None:
        return
    saved = {model.get("name", ""): model for model in state.findall("model")}
    for model in world:
        name = name_of(model)
        at = saved[name].find("pose") if model.tag in ("model", "include") and name in saved else None
        if at is None:
            continue
        for pose in model.findall("pose"):
            model.remove(pose)
        SubElement(model, "pose").text = at.text
        scale = saved[name].findtext("scale")
        if scale:
            model.set("scale", scale)


def is_robot(model: Element) -> bool:
    """A model that a plugin drives: it is no part of the building."""
    plugins = [*model.findall("plugin"), *model.findall("link/plugin")]
    names = (f"{plugin.get('name', '')} {plugin.get('filename', '')}".lower().replace("-", "_") for plugin in plugins)
    return any(DRIVES.search(name) for name in names)


def person_of(actor: Element, pose: Callable[[Element], np.ndarray], path: Path) -> Person | None:
    """Who walks as an <actor>'s first trajectory says, there and back where it does not end where it began; None: stands.
    pose: of an element that holds <pose>, (4, 4); path: of the file. Raises ConfigError."""
    trajectory = actor.find("script/trajectory")
    stops = [] if trajectory is None else [(_seconds(stop, path), pose(stop)[:2, 3])
                                           for stop in trajectory.findall("waypoint")]
    corners: list[np.ndarray] = []
    pauses: list[float] = []
    before, walking_s = 0.0, 0.0
    for time, at in sorted(stops, key=lambda stop: stop[0]):
        if corners and np.hypot(*(at - corners[-1])) < SAME_M:
            pauses[-1] += time - before
        else:
            walking_s += time - before if corners else 0.0
            corners.append(at)
            pauses.append(0.0)
        before = time
    if len(corners) < 2:
        return None
    length_m = float(np.hypot(*np.diff(corners, axis=0).T).sum())
    if len(corners) > 2 and np.hypot(*(corners[0] - corners[-1])) < CLOSED_M:
        corners, pauses = corners[:-1], [pauses[0] + pauses[-1], *pauses[1:-1]]
    else:
        corners, pauses = [*corners, *corners[-2:0:-1]], [*pauses, *pauses[-2:0:-1]]
    speed = float(np.clip(length_m / max(walking_s, 1e-6), SLOWEST_MPS, FASTEST_MPS))
    return Person(actor.get("name", "actor"), np.array(corners), speed, tuple(pauses))


def _seconds(waypoint: Element, path: Path) -> float:
    text = (waypoint.findtext("time") or "0").strip()
    try:
        seconds = float(text)
    except ValueError:
        seconds = float("nan")
    if not 0.0 <= seconds <= LONGEST_S:
        raise ConfigError(f"{path}: <time> of an actor's waypoint is {text[:40]!r}; expected 0 to {LONGEST_S:g} seconds")
    return seconds


def installed(name: str) -> list[Path]:
    """Where Gazebo would look for a model, or a file in one, on this machine."""
    folders = [Path(folder) for key in MODEL_PATHS for folder in os.environ.get(key, "").split(os.pathsep) if folder]
    return [folder / name for folder in (*folders, Path.home() / ".gazebo" / "models")]


def downloaded(uri: str) -> tuple[str, list[Path]]:
    """(name, where its versions may lie, the newest first) of a model of Gazebo Fuel, https://HOST/1.0/OWNER/models/NAME."""
    parts = [unquote(part) for part in urlsplit(uri).path.split("/") if part]
    if "models" not in parts[1:-1]:
        return "", []
    at = parts.index("models", 1)
    owner, name, host = parts[at - 1], parts[at + 1], urlsplit(uri).hostname or ""
    folders = [Path.home() / cache / "fuel" / host / owner.lower() / "models" / name.lower()
               for cache in (".gz", ".ignition")]
    versions = [version for folder in folders if folder.is_dir() for version in folder.iterdir() if version.name.isdigit()]
    return name, sorted(versions, key=lambda version: -int(version.name))


def fetched(missing: list[str]) -> str:
    """What to type for the first missing model of Gazebo Fuel, after a semicolon; empty where there is none."""
    return next((f"; type: gz fuel download -u {uri}" for uri in missing if uri.startswith(("https://", "http://"))), "")
