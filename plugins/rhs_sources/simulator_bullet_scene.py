"""The world as PyBullet shows it: two renderers, its software one (TinyRenderer) and OpenGL.

Every call names its physics client, so that several scenes live in one process.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np

from rhs.api.errors import RhsError
from rhs.api.floorplan import World
from rhs.api.geometry import Camera, inverse, se3
from rhs.api.records import Scan
from rhs.worlds.live import Stand

from .simulator_bullet import Client, pybullet, quiet
from .simulator_laser import LaserScanner
from .simulator_mesh import Quad, building, lit
from .simulator_scene import Look, Scene

NEAR_M, FAR_M = 0.1, 60.0
# TinyRenderer divides by the depth of a triangle's corners, also of those beside or behind the camera. Pieces this small
# are out of view before one of their corners comes level with the lens.
WALL_PIECE_M, FLOOR_PIECE_M = 0.5, 1.0
LEVEL_M = 1e-5  # nearer than this to the plane of the lens counts as level with it: ten times float32's grain at 20 m
NUDGES_M = (0.0, 3e-5, -3e-5, 6e-5, -6e-5, 9e-5, -9e-5)
SHADELESS = {"lightAmbientCoeff": 1.0, "lightDiffuseCoeff": 0.0, "lightSpecularCoeff": 0.0, "shadow": 0}


class BulletScene(Client, Scene):
    """A PyBullet client showing one world. `close` it."""

    def __init__(self, world: World, camera: Camera, look: Look) -> None:
        super().__init__()
        self.world, self.camera, self.look = world, camera, look
        with quiet():
            self.renderer = look.renderer if look.renderer != "egl" or self._load_egl() else "tinyrenderer"
        self.vertices = np.zeros((0, 3))
        self.projection = projection(camera, half=0.0 if self.renderer == "tinyrenderer" else 1.0)
        look.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=look.folder, prefix="scene.tmp-") as scratch, quiet():
            self._build(Path(scratch))

    def _load_egl(self) -> bool:
        """Whether PyBullet's OpenGL renderer works here: without EGL it ends the process, so a child tries first."""
        spec = importlib.util.find_spec("eglRenderer")
        if spec is None or spec.origin is None:
            return False
        probe = ("import pybullet as p, sys; c = p.connect(p.DIRECT); "
                 "ok = p.loadPlugin(sys.argv[1], '_eglRendererPlugin', physicsClientId=c) >= 0; "
                 "p.getCameraImage(8, 8, physicsClientId=c); sys.exit(0 if ok else 1)")
        done = subprocess.run([sys.executable, "-c", probe, spec.origin], capture_output=True, check=False)
        return done.returncode == 0 and pybullet.loadPlugin(
            spec.origin, "_eglRendererPlugin", physicsClientId=self.client) >= 0

    def _build(self, scratch: Path) -> None:
        for quads, image in lit(building(self.world, self.look.px_per_m), self.world.light):
            self._show(scratch, quads, image)

    def _show(self, scratch: Path, quads: list[Quad], image: np.ndarray) -> None:
        """Add quads wearing parts of one image, cut into pieces.

        The textures are set once and the mesh names no material: PyBullet's OpenGL renderer mixes them up otherwise."""
        quads = [piece for quad in quads for piece in cut(*quad)]
        number = len(list(scratch.iterdir()))  # PyBullet remembers files by name: no name is used twice
        mesh, picture = scratch / f"{number}.obj", scratch / f"{number}.bmp"
        corners = np.concatenate([self.vertices, *(corners for corners, _ in quads)])
        self.vertices = np.unique(corners, axis=0)
        mesh.write_text(obj_text(quads), encoding="ascii")
        cv2.imwrite(str(picture), image[..., ::-1])
        shape = pybullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(mesh), rgbaColor=[1, 1, 1, 1],
                                           specularColor=[0, 0, 0], physicsClientId=self.client)
        body = pybullet.createMultiBody(0, -1, shape, physicsClientId=self.client)
        texture = pybullet.loadTexture(str(picture), physicsClientId=self.client)
        if min(shape, body, texture) < 0:
            raise RhsError(f"source.simulator: PyBullet could not take a mesh of world {self.world.name}")
        pybullet.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=self.client)

    def render(self, world_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        camera, nudge = self.camera, self._nudge(world_from_body)
        gl_from_optical = se3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
        view = gl_from_optical @ inverse(world_from_body @ camera.body_from_camera)
        view[2, 3] += nudge
        opengl = self.renderer == "egl"
        which = pybullet.ER_BULLET_HARDWARE_OPENGL if opengl else pybullet.ER_TINY_RENDERER
        with quiet() if opengl else nullcontext():
            _, _, rgba, buffer, _ = pybullet.getCameraImage(
                camera.width, camera.height, view.T.ravel().tolist(), self.projection.T.ravel().tolist(),
                renderer=which, flags=pybullet.ER_NO_SEGMENTATION_MASK, physicsClientId=self.client, **SHADELESS)
        image = np.asarray(rgba, np.uint8).reshape(camera.height, camera.width, 4)[..., :3].copy()
        window = np.asarray(buffer, np.float64).reshape(camera.height, camera.width)
        depth = FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * window)
        depth[window >= 1.0] = np.nan
        return image, (depth + nudge).astype(np.float32)

    def place(self, stands: list[Stand]) -> None:
        """Nothing moves in a world that is drawn by PyBullet."""

    def _nudge(self, world_from_body: np.ndarray) -> float:
        """Metres, at most a few hundredths of a millimetre, by which to push the camera along its axis.

        A corner of a mesh exactly level with the lens has depth zero; the software renderer divides by it and then
        counts through two thousand million pixels."""
        world_from_camera = world_from_body @ self.camera.body_from_camera
        depth = (self.vertices - world_from_camera[:3, 3]) @ world_from_camera[:3, 2]
        for nudge in NUDGES_M:
            if np.abs(depth - nudge).min() > LEVEL_M:
                return nudge
        return NUDGES_M[-1]

    def scan(self, laser: LaserScanner, world_from_body: np.ndarray) -> Scan:
        raise NotImplementedError(f"source.renderer={self.renderer} has no laser scanner")  # Simulator refuses it


def projection(camera: Camera, *, half: float) -> np.ndarray:
    """4x4 OpenGL projection whose pixels are exactly those of the camera (pixel centres on whole numbers).

    half: 1 for OpenGL, which samples pixel i at i + 1/2; 0 for PyBullet's software renderer, which samples it at i."""
    w, h, n, f = camera.width, camera.height, NEAR_M, FAR_M
    return np.array([
        [2 * camera.fx / w, -2 * camera.skew / w, 1 - (2 * camera.cx + half) / w, 0],
        [0, 2 * camera.fy / h, 1 - (2 * (h - 1 - camera.cy) + half) / h, 0],
        [0, 0, -(f + n) / (f - n), -2 * f * n / (f - n)],
        [0, 0, -1, 0],
    ])


def cut(corners: np.ndarray, uv: np.ndarray) -> list[Quad]:
    """A quad cut into pieces: an upright one along its width alone."""
    width_m, height_m = (float(np.linalg.norm(corners[k] - corners[0])) for k in (1, 3))
    upright = abs(corners[3, 2] - corners[0, 2]) > 0
    columns = max(1, round(width_m / (WALL_PIECE_M if upright else FLOOR_PIECE_M)))
    rows = 1 if upright else max(1, round(height_m / FLOOR_PIECE_M))
    quads = []
    for j in range(rows):
        for i in range(columns):
            st = np.array([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]]) / (columns, rows)
            s, t = st[:, :1], st[:, 1:]
            weights = np.hstack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
            quads.append((weights @ corners, weights @ uv))
    return quads


def obj_text(quads: list[Quad]) -> str:
    """A Wavefront OBJ of quads, two triangles each, with texture corners and normals and without a material."""
    lines = []
    for number, (face, uv) in enumerate(quads):
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in face]
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in uv]
        lines.append("vn {:.9g} {:.9g} {:.9g}".format(*(normal / np.linalg.norm(normal))))
        for corners in ((1, 2, 3), (1, 3, 4)):
            lines.append("f " + " ".join(f"{4 * number + c}/{4 * number + c}/{number + 1}" for c in corners))
    return "\n".join(lines) + "\n"
