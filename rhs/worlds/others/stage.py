"""Worlds of Player/Stage (.world): the floor plan, a picture with its size in metres, dark pixels solid (Stage's manual,
rtv.github.io/Stage, of models and world files). Robots and other models are left out."""

from __future__ import annotations

import logging
import re
from pathlib import Path

from rhs.api.grid import OccupancyGrid
from rhs.api.pictures import declared_size, head_of
from rhs.base.errors import ConfigError

from ..maps import MapHeader, map_of

STAGE = re.compile(r"^\s*(include\s+\"|define\s+\w+|resolution\s|floorplan|window\b)", re.M)
MODEL = re.compile(r"\b(?:floorplan|map)\s*\(([^()]*)\)", re.S)
HEAD_BYTES = 100_000
SOLID = 0.5  # from which share of black on a pixel is solid
SQUARE = 0.02  # by which a pixel may be wider than high

log = logging.getLogger("rhs.worlds")


def plan_in(path: Path) -> OccupancyGrid | None:
    """The floor plan of a world of Stage; None of another file. Raises ConfigError in one line."""
    with path.open("rb") as file:
        text = file.read(HEAD_BYTES).decode("utf-8", "replace")
    if text.lstrip("\ufeff \t\r\n").startswith("<") or not STAGE.search(text):
        return None
    plan = MODEL.search(re.sub(r"#.*", "", text))
    within = "" if plan is None else plan[1]
    picture = re.search(r'bitmap\s+"([^"]+)"', within)
    size, pose = (_numbers(word, within) for word in ("size", "pose"))
    if picture is None or len(size) < 2 or min(size[:2]) <= 0.0:
        raise ConfigError(f"{path}: a world of Stage without floorplan ( bitmap \"NAME.png\" size [x y z] ); name its "
                          "picture as a plan: write a .yaml with the lines `image:` and `resolution:` (metres a pixel)")
    image = path.parent / picture[1]
    pixels = declared_size(head_of(image)) if image.is_file() else None
    if pixels is None:
        found = "no picture" if image.is_file() else "not there"
        raise ConfigError(f"{path}: its floor plan {picture[1]} is {found}; put it beside the world as .png or .pgm")
    wide, high = size[0] / pixels[0], size[1] / pixels[1]
    if abs(wide / high - 1.0) > SQUARE or (len(pose) > 2 and pose[-1] != 0.0):
        raise ConfigError(f"{path}: the pixels of its floor plan are {wide:.4g} x {high:.4g} m, turned by "
                          f"{pose[-1] if len(pose) > 2 else 0.0:g} degrees; expected square ones, not turned")
    x, y, *_ = [*pose, 0.0, 0.0]
    log.warning("%s: its floor plan %s, %g x %g m; robots and other models are left out", path.name, picture[1], *size[:2])
    return map_of(MapHeader(image, wide, (x - 0.5 * size[0], y - 0.5 * size[1], 0.0), False, "trinary", SOLID, SOLID))


def _numbers(word: str, text: str) -> list[float]:
    found = re.search(rf"\b{word}\s*\[([^\]]*)\]", text)
    try:
        return [] if found is None else [float(number) for number in found[1].split()]
    except ValueError:
        return []
