"""Where the things of an SDF stand: numbers, poses and the frames that poses are told relative to.

Written after the SDFormat specification, "Pose frame semantics" (http://sdformat.org/tutorials?tut=pose_frame_semantics).
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from rhs.api.geometry import rotation_of_quaternion, se3
from rhs.base.errors import ConfigError

DEEPEST = 30  # a model that includes itself must end
FRAMES = ("model", "link", "include", "frame", "joint")  # what poses may be told relative to
HOW_XACRO = "a xacro is a recipe of a file; expand it first: xacro {file} > robot.urdf"


def poses_in(missing: list[str], parent: Element, path: Path) -> dict[str | int, np.ndarray]:
    """id, and name, of each child -> where it stands in its parent (SDFormat 1.7 to 1.11, pose frame semantics): by
    `relative_to`, else a frame by what it is attached to and a joint by its child; `a::b` is b of the model a. Names that
    nothing has are among the missing."""
    named = {name_of(child): child for child in parent if child.tag in FRAMES}

    def stands(child: Element, above: int) -> np.ndarray:
        pose = child.find("pose")
        told = (pose.get("relative_to") or pose.get("frame") or "") if pose is not None else ""
        name = told or child.get("attached_to") or (child.findtext("child") or "").strip() * (child.tag == "joint")
        first, *inner = name.split("::")
        base = named.get(first)
        if base is None or base is child or above > DEEPEST:
            if told not in ("", "world", "__model__", "__root__", name_of(child)):
                missing.insert(0, f"the frame {told}, so that what stands by it stands elsewhere")
            return pose_of(child, path)
        at = stands(base, above + 1)
        if inner:
            at = at @ frame_in(missing, base, "::".join(inner), path)
        own: np.ndarray = at @ pose_of(child, path)
        return own

    out: dict[str | int, np.ndarray] = {id(child): stands(child, 0) for child in parent if child.tag in FRAMES}
    return out | {name: out[id(child)] for name, child in named.items()}


def frame_in(missing: list[str], model: Element, name: str, path: Path) -> np.ndarray:
    """Where a frame of a model stands in it; where it has none of that name it is among the missing."""
    first, *inner = name.split("::")
    found = next((child for child in model if child.tag in FRAMES and name_of(child) == first), None)
    if found is None:
        missing.insert(0, f"the frame {name}, so that what stands by it stands elsewhere")
        return np.eye(4)
    at = poses_in(missing, model, path)[first]
    return at @ frame_in(missing, found, "::".join(inner), path) if inner else at


def name_of(child: Element) -> str:
    """The name of an element; of an include what it is called, or the last part of its uri."""
    uri = (child.findtext("uri") or "").strip().rstrip("/")
    return child.get("name") or (child.findtext("name") or "").strip() or uri.rsplit("/", 1)[-1]


def pose_of(element: Element, path: Path) -> np.ndarray:
    """(4, 4) of the <pose> of an SDF element: x y z roll pitch yaw, or x y z and a quaternion x y z w."""
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    if pose.get("rotation_format") == "quat_xyzw":
        values = values_of(pose.text, 7, "pose", path)
        return se3(rotation_of_quaternion(values[3:]) if values[3:].any() else np.eye(3), values[:3])
    values = values_of(pose.text, 6, "pose", path)
    return placed_at(values[:3], np.radians(values[3:]) if pose.get("degrees") in ("true", "1") else values[3:])


def placed_at(xyz: np.ndarray, rpy: np.ndarray) -> np.ndarray:
    """(4, 4) from a place and fixed-axis roll, pitch, yaw, radians."""
    from scipy.spatial.transform import Rotation

    return se3(Rotation.from_euler("xyz", rpy).as_matrix(), xyz)


def numbers_in(element: Element, key: str, count: int, path: Path) -> np.ndarray:
    """(count,) the numbers of the child called key. Raises ConfigError."""
    return values_of(element.findtext(key), count, key, path)


def values_of(text: str | None, count: int, key: str, path: Path) -> np.ndarray:
    """(count,) the numbers in a text; key: what they are called. Raises ConfigError with the file where they are others."""
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.empty(0)
        if "${" in (text or ""):
            raise ConfigError(f"{path}: {HOW_XACRO.format(file=path.name)}") from None
    if len(values) != count or not np.isfinite(values).all() or np.abs(values).max(initial=0.0) > 1e6:
        raise ConfigError(f"{path}: <{key}> is {(text or '').strip()[:60]!r}; expected {count} finite numbers")
    return values
