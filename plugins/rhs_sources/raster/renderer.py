"""Draws textured faces as a camera sees them: project, find what is visible, shade."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, inverse
from rhs.api.spare import both

from .shade import shade
from .textures import pyramids
from .visible import find_visible, project

Quad = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Mesh:
    """Faces with textures. vertices_m (V, 3) float64; faces (F, 5) int32: three or four vertices counter-clockwise as seen
    (the fourth -1: a triangle; four lie in one plane, convex), and the texture; uv (F, 3, 2) float64: place of the first
    three in texels from the top left; texels, levels: of `pyramids`; repeats (T,) bool: whether a texture goes on in copies
    of itself beyond its edges, or in its outermost texels."""

    vertices_m: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texels: np.ndarray
    levels: np.ndarray
    repeats: np.ndarray

    @classmethod
    def of_triangles(cls, corners_m: np.ndarray, uv: np.ndarray, texture: np.ndarray, images: Sequence[np.ndarray]) -> Mesh:
        """From triangles (N, 3, 3) that are seen from both sides, texture corners (N, 3, 2) (u right, v up, 0..1 over the
        image and on in copies of it), and which of the images (H, W, 3) each wears."""
        count = len(corners_m)
        texels, levels = pyramids(images)
        front = np.column_stack([np.arange(3 * count).reshape(-1, 3), np.full(count, -1), texture])
        places = np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1) * levels[texture, 0, 1:][:, None]
        faces = np.concatenate([front, front[:, [0, 2, 1, 3, 4]]]).astype(np.int32)
        return cls(corners_m.reshape(-1, 3).astype(float), faces, np.concatenate([places, places[:, [0, 2, 1]]]), texels,
                   levels, np.ones(len(images), bool))

    @classmethod
    def of_quads(cls, painted: Iterable[tuple[list[Quad], np.ndarray]]) -> Mesh:
        """From pairs of quads and the image they wear. A quad: (4, 3) corners counter-clockwise as seen, in one plane, and
        (4, 2) texture corners (u right, v up, 0..1 over the image)."""
        groups = list(painted)
        corners = [corners for quads, _ in groups for corners, _ in quads]
        textures = np.repeat(np.arange(len(groups)), [len(quads) for quads, _ in groups])
        faces = np.column_stack([np.arange(4 * len(corners)).reshape(-1, 4), textures])
        uv = [np.column_stack([at[:3, 0] * image.shape[1], (1.0 - at[:3, 1]) * image.shape[0]])
              for quads, image in groups for _, at in quads]
        texels, levels = pyramids([image for _, image in groups])
        return cls(np.concatenate(corners).astype(float), faces.astype(np.int32), np.array(uv, float), texels, levels,
                   np.zeros(len(groups), bool))

    def __add__(self, other: Mesh) -> Mesh:
        """Both."""
        faces, levels = other.faces.copy(), other.levels.copy()
        faces[:, :4] += np.where(faces[:, :4] >= 0, len(self.vertices_m), 0).astype(np.int32)
        faces[:, 4] += len(self.levels)
        levels[..., 0] += len(self.texels)
        pairs = ((self.vertices_m, other.vertices_m), (self.faces, faces), (self.uv, other.uv),
                 (self.texels, other.texels), (self.levels, levels), (self.repeats, other.repeats))
        return Mesh(*(np.concatenate(pair) for pair in pairs))


class Renderer:
    """Draws meshes for one camera, lens left out. For one thread at a time: it keeps its buffers. The interpreter's lock is
    free while it draws."""

    def __init__(self, camera: Camera, *, probes: int = 8) -> None:
        """probes: samples at most along the longer axis of a pixel's footprint; 0: the nearest texel, unfiltered."""
        self.camera, self.probes = camera, probes
        shape = camera.height, camera.width
        self._inverse_m, self._seen = np.empty(shape, np.float32), np.empty(shape, np.int32)
        self._fit(0, 0)

    def _fit(self, vertices: int, faces: int) -> None:
        """Make room for so many."""
        self._vertices_px, self._beyond = np.empty((vertices, 3)), np.empty(vertices, np.uint8)
        self._planes, self._shown = np.empty((faces + 1, 10)), np.empty(faces + 1, np.int32)

    def render(self, mesh: Mesh, world_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """RGB (H, W, 3) uint8 and depth (H, W) float32 in metres along the optical axis; white and NaN where nothing is."""
        camera = self.camera
        camera_from_world = inverse(world_from_body @ camera.body_from_camera)
        if (len(mesh.vertices_m), len(mesh.faces) + 1) != (len(self._beyond), len(self._shown)):
            self._fit(len(mesh.vertices_m), len(mesh.faces))
        pixels_from_world = np.ascontiguousarray(camera.matrix @ camera_from_world[:3])
        project(pixels_from_world, mesh.vertices_m, camera.width, camera.height, self._vertices_px, self._beyond)
        self._inverse_m.fill(0.0)
        self._seen.fill(-1)
        count = find_visible(self._vertices_px, self._beyond, mesh.faces, mesh.uv, self._inverse_m, self._seen, self._planes,
                             self._shown)
        image = np.empty((camera.height, camera.width, 3), np.uint8)
        depth_m = np.empty((camera.height, camera.width), np.float32)
        textures = np.ascontiguousarray(mesh.faces[self._shown[:count], 4])
        faces = self._seen, self._planes, textures, mesh.texels, mesh.levels, mesh.repeats, self.probes, image, depth_m
        middle = camera.height // 2
        both(lambda: shade(*faces, 0, middle), lambda: shade(*faces, middle, camera.height))
        return image, depth_m
