"""`python -m rhs worlds`: the buildings that come with the program, and the families that are drawn.

    python -m rhs worlds                              name, size, places, survey, one line each
    python -m rhs worlds random:office random:home/3  drawn buildings: the first ones of a family, or one by its number
        --pictures FOLDER   a plan of each, and worlds.png with all of them
        --buildings N       of each family (4)
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rhs.api.floorplan import World
from rhs.worlds.random.names import FAMILIES, PREFIX, is_random, parse
from rhs.worlds.world import find_world, load_world, world_names

from .arguments import Number
from .arguments import parse as parsed


def main(words: Sequence[str]) -> int:
    """The command."""
    chosen = parsed("worlds", __doc__, words, pictures="", buildings=Number(4, low=1, high=1000))
    families = [] if chosen.typed or chosen.pictures else list(FAMILIES)
    every = chosen.typed or [*world_names(), *(f"{PREFIX}{family}" for family in FAMILIES if not families)]
    names = [one for name in every for one in (numbered(name, chosen.buildings) if is_random(name) else [name])]
    worlds = [(name, load_world(name)) for name in names]
    if chosen.pictures:
        from rhs.reports.world_pictures import write_pictures

        write_pictures(worlds, Path(chosen.pictures))
    drawn = [f"{PREFIX + family:<22} {'drawn':>11} {'3 to 6':>6} {'':>8}  {FAMILIES[family]}" for family in families]
    sys.stdout.write("\n".join([*listed(worlds), *drawn, ""]))
    if chosen.pictures:
        sys.stdout.write(f"files: {chosen.pictures}\n")
    return 0


def numbered(name: str, count: int) -> list[str]:
    """The first buildings of a family by number; what has a number stays."""
    return [name] if parse(name).number is not None else [f"{name}/{number}" for number in range(count)]


def listed(worlds: Sequence[tuple[str, World]]) -> list[str]:
    """One line for each world, under a heading."""
    wide = max([len(name) for name, _ in worlds] + [22])
    lines = [f"{'world':<{wide}} {'size m':>11} {'places':>6} {'survey m':>8}"]
    for name, world in worlds:
        x0, y0, x1, y1 = world.bounds_m
        way = float(np.hypot(*np.diff(world.route_m, axis=0).T).sum())
        size = f"{x1 - x0:.1f} x {y1 - y0:.1f}"
        lines.append(f"{name:<{wide}} {size:>11} {len(world.places):>6} {way:>8.0f}  {_said(name)}")
    return lines


def _said(name: str) -> str:
    """The first words of a world's file, or of its family."""
    if is_random(name):
        return FAMILIES[parse(name).family]
    path = find_world(name)
    if path.suffix.lower() not in (".yaml", ".yml"):
        return ""
    first = path.read_text("utf-8-sig").split("\n", 1)[0]
    return first.lstrip("# ").strip() if first.startswith("#") else ""
