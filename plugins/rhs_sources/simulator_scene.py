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
from rhs.api.records import Scan
from rhs.worlds.live import Stand, shapes_of

from .raster.renderer import Mesh, Renderer
from .simulator_laser import LaserScanner
from .simulator_mesh import brighter, building, lit, shape_faces


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

    def scan(self, laser: LaserScanner, world_from_body: np.ndarray) -> Scan:
        """What the laser sees from there. Only the rasteriser keeps the faces that it would cut."""

    def place(self, stands: list[Stand]) -> None:
        """Put what moves (rhs.worlds.live.shapes_of) where it is now."""

    def close(self) -> None:
        """Forget the world; safe to call twice."""


def scene_of(world: World, camera: Camera, look: Look) -> Scene:
    """The scene of this world that the wanted renderer draws."""
    if look.renderer == "raster":
        return RasterScene(world, camera, look)
    if world.mesh is not None or not world.moving.still:
        what = "what moves" if world.mesh is None else "somebody else's building"
        raise ConfigError(f"source.renderer={look.renderer} does not draw {what}; type source.renderer=raster")
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
        self.moved: list[tuple[slice, np.ndarray]] = []  # vertices of each shape that moves, and where they are in its frame
        for shape in shapes_of(world.moving):
            own = Mesh.of_quads(lit(shape_faces(world, shape, look.px_per_m), world.light))
            begin = len(self.mesh.vertices_m)
            self.moved.append((slice(begin, begin + len(own.vertices_m)), own.vertices_m))
            self.mesh += own

    def render(self, world_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.drawer.render(self.mesh, world_from_body)

    def scan(self, laser: LaserScanner, world_from_body: np.ndarray) -> Scan:
        return laser.scan(self.mesh.vertices_m, self.mesh.faces[:, :4], world_from_body)

    def place(self, stands: list[Stand]) -> None:
        for (rows, corners), stand in zip(self.moved, stands, strict=True):
            c, s = np.cos(stand.yaw_rad), np.sin(stand.yaw_rad)
            turned = corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            self.mesh.vertices_m[rows] = turned + (stand.x_m, stand.y_m, stand.bottom_m)

    def close(self) -> None:
        """Nothing is open."""
