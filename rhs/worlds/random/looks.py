"""How a drawn building looks: surfaces, paintings many or few, all different or much alike, walls low or high."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.floorplan import Paintings, Surface

WALLS = ("plaster", "plaster", "plain", "brick", "wood", "tiles")
FLOORS = ("carpet", "tiles", "wood")


@dataclass(frozen=True)
class Looks:
    """Of one building. walls: the few surfaces that its walls share; paper: share of walls that get one of the others."""

    walls: tuple[Surface, ...]
    floor: Surface
    ceiling: Surface
    paintings: Paintings
    wall_height_m: float


def surface(rng: np.random.Generator, recipes: tuple[str, ...], *, light: tuple[float, float],
            rough: tuple[float, float]) -> Surface:
    """A surface of some recipe and tint, as light and as rough as drawn between these grey levels."""
    level = rng.uniform(*light)
    colour = np.clip(level + rng.uniform(-28.0, 28.0, 3), 20.0, 245.0).round()
    recipe = recipes[int(rng.integers(len(recipes)))]
    return Surface(recipe, (float(colour[0]), float(colour[1]), float(colour[2])), round(float(rng.uniform(*rough)), 1))


def looks(rng: np.random.Generator) -> Looks:
    """Half of the buildings have paintings that all differ, the others a few dozen or a handful that come back."""
    walls = tuple(surface(rng, WALLS, light=(130.0, 220.0), rough=(3.0, 22.0)) for _ in range(3))
    wide, high = rng.uniform(0.35, 0.8), rng.uniform(0.3, 0.7)
    paintings = Paintings(
        unique=(1000, 1000, 40, 8)[int(rng.integers(4))], density=round(float(rng.uniform(0.15, 1.0)), 3),
        spacing_m=round(float(rng.uniform(1.0, 2.4)), 3),
        width_m=(round(float(wide), 3), round(float(wide * rng.uniform(1.1, 1.8)), 3)),
        height_m=(round(float(high), 3), round(float(high * rng.uniform(1.1, 1.5)), 3)),
        middle_m=round(float(rng.uniform(1.2, 1.5)), 3))
    floor = surface(rng, FLOORS, light=(90.0, 170.0), rough=(10.0, 35.0))
    ceiling = surface(rng, ("tiles", "plaster", "plain"), light=(190.0, 225.0), rough=(2.0, 14.0))
    return Looks(walls, floor, ceiling, paintings, round(float(rng.uniform(2.2, 3.2)), 3))


def furniture_surface(rng: np.random.Generator) -> Surface:
    """Of a piece of furniture."""
    return surface(rng, ("wood", "wood", "carpet", "plaster", "tiles"), light=(60.0, 210.0), rough=(4.0, 25.0))
