"""The world as something to look at: textured faces without thickness. What is solid: simulator_solid.py.

A scene draws what is seen from a pose; the rasteriser of rhs (raster/) or one of PyBullet's renderers does it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.floorplan import World
from rhs.api.geometry import Camera

from .raster.renderer import Mesh, Renderer
from .simulator_mesh import brighter, building, lit


@dataclass(frozen=True)
class Look:
    """How a scene is drawn: texture pixels per metre; the renderer wanted (raster, tinyrenderer or egl); probes at most of
    the rasteriser (0: the nearest texel); a scratch folder."""

    px_per_m: float
    renderer: str
    probes: int
    folder: Path


class Scene(Protocol):
    """A world to look at. `close` it. renderer: what draws it."""

    renderer: str

    def render(self, world_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """RGB (H, W, 3) uint8 and depth (H, W) float32 in metres along the optical axis, NaN where nothing is."""

    def close(self) -> None:
        """Forget the world; safe to call twice."""


def scene_of(world: World, camera: Camera, look: Look) -> Scene:
    """The scene of this world that the wanted renderer draws."""
    if look.renderer == "raster":
        return RasterScene(world, camera, look)
    if world.mesh is not None:
        raise ConfigError(f"source.renderer={look.renderer} does not draw somebody else's building; type "
                          "source.renderer=raster")
    from .simulator_bullet_scene import BulletScene

    return BulletScene(world, camera, look)


class RasterScene(Scene):
    """A world drawn by the rasteriser."""

    renderer = "raster"

    def __init__(self, world: World, camera: Camera, look: Look) -> None:
        self.drawer = Renderer(camera, probes=look.probes)
        self.mesh = Mesh.of_quads(lit(building(world, look.px_per_m), world.light))
        if world.mesh is not None:
            images = [brighter(image, world.light.brightness) for image in world.mesh.images]
            self.mesh += Mesh.of_triangles(world.mesh.corners_m, world.mesh.uv, world.mesh.texture, images)

    def render(self, world_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.drawer.render(self.mesh, world_from_body)

    def close(self) -> None:
        """Nothing is open."""
