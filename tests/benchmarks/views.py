"""What a view costs: `python tests/benchmarks/views.py [--views 100] [--out results/tables]`.

The simulator's renderers draw the same views turn by turn, along the world's own route: 320x240, 57 degrees, textures of 150
px/m; then the same with the building cut into 100,000 triangles. Times are CPU times of the calling thread, so that
other work on the machine counts little; the first view of each is not counted.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from shared import write

from rhs.api.floorplan import World
from rhs.api.geometry import Camera, camera_from_fov, se2
from rhs.worlds.world import load_world
from rhs_sources.raster.renderer import Mesh, Renderer
from rhs_sources.simulator import pace
from rhs_sources.simulator_bullet_scene import BulletScene
from rhs_sources.simulator_config import Simulator
from rhs_sources.simulator_mesh import Painted, Quad, building
from rhs_sources.simulator_route import waypoints
from rhs_sources.simulator_scene import Look

PX_PER_M = 150.0
TRIANGLES = 100_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", type=int, default=100)
    parser.add_argument("--worlds", nargs="*", default=["square", "home"])
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for world in map(load_world, chosen.worlds):
        route = waypoints(world.route_m, world.start[2], pace(Simulator()))
        stands = [route[int(k)] for k in np.linspace(0, len(route) - 1, chosen.views)]
        poses = [se2(at.x_m, at.y_m, at.yaw_rad) for at in stands]
        whole = list(building(world, PX_PER_M))
        fine = finely_cut(whole)
        rows += compared(world.name, world, whole, Mesh.of_quads(whole), poses)
        rows += compared(f"{world.name}, triangles", world, fine, triangles(Mesh.of_quads(fine)), poses)
    write(chosen.out / "views.csv", rows)
    print((chosen.out / "views.csv").read_text())


def compared(scene: str, world: World, painted: list[Painted], mesh: Mesh, poses: list[np.ndarray]) -> list[dict[str, Any]]:
    """A row for each renderer: faces drawn, CPU ms of a view."""
    camera = camera_from_fov(320, 240, 57.0, height_m=world.camera_height_m)
    with tempfile.TemporaryDirectory() as folder:
        bullet = Shown(world, camera, Look(PX_PER_M, "tinyrenderer", 0, Path(folder)), painted)
        draws: dict[str, Callable[[np.ndarray], Any]] = {"tinyrenderer": bullet.render}
        for word, probes in (("nearest", 0), ("anisotropic", 8)):
            draws[f"raster, {word}"] = partial(Renderer(camera, probes=probes).render, mesh)
        spent: dict[str, list[float]] = {who: [] for who in draws}
        for pose in [poses[0], *poses]:
            for who, draw in draws.items():
                begin = time.thread_time()
                draw(pose)
                spent[who].append(1e3 * (time.thread_time() - begin))
        bullet.close()
    return [{"scene": scene, "renderer": who, "faces": bullet.faces if who == "tinyrenderer" else len(mesh.faces),
             "views": len(poses), "median_ms": float(np.median(times[1:])), "p90_ms": float(np.quantile(times[1:], 0.9))}
            for who, times in spent.items()]


class Shown(BulletScene):
    """PyBullet showing these quads, cut as it needs them."""

    def __init__(self, world: World, camera: Camera, look: Look, painted: list[Painted]) -> None:
        self.painted, self.faces = painted, 0
        super().__init__(world, camera, look)

    def _build(self, scratch: Path) -> None:
        for quads, image in self.painted:
            self._show(scratch, quads, image)
        for mesh in scratch.glob("*.obj"):
            self.faces += mesh.read_text().count("\nf ")


def finely_cut(painted: list[Painted]) -> list[Painted]:
    """The same in about half as many square quads as there shall be triangles."""
    sides = [[np.linalg.norm(corners[[1, 3]] - corners[0], axis=1) for corners, _ in quads] for quads, _ in painted]
    piece_m = np.sqrt(2.0 * sum(np.prod(side) for group in sides for side in group) / TRIANGLES)
    return [([piece for (corners, uv), side in zip(quads, group, strict=True)
              for piece in cut(corners, uv, np.ceil(side / piece_m).astype(int))], image)
            for (quads, image), group in zip(painted, sides, strict=True)]


def cut(corners: np.ndarray, uv: np.ndarray, counts: np.ndarray) -> list[Quad]:
    """A quad in counts = (columns, rows) quads."""
    i, j = np.indices(counts).reshape(2, -1, 1)
    s, t = (i + [0, 1, 1, 0]) / counts[0], (j + [0, 0, 1, 1]) / counts[1]
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=-1)
    return list(zip(weights @ corners, weights @ uv, strict=True))


def triangles(mesh: Mesh) -> Mesh:
    """The same with each quad, a parallelogram, as two triangles that share corners with their neighbours, as in files."""
    vertices_m, number = np.unique(mesh.vertices_m.round(9), axis=0, return_inverse=True)
    faces = np.column_stack([number.ravel()[mesh.faces[:, :4]], mesh.faces[:, 4]]).astype(np.int32)
    first, second = faces.copy(), faces[:, [0, 2, 3, 3, 4]]
    first[:, 3] = second[:, 3] = -1
    across = np.stack([mesh.uv[:, 0], mesh.uv[:, 2], mesh.uv[:, 0] + mesh.uv[:, 2] - mesh.uv[:, 1]], axis=1)
    return replace(mesh, vertices_m=vertices_m, faces=np.concatenate([first, second]), uv=np.concatenate([mesh.uv, across]))


if __name__ == "__main__":
    main()
