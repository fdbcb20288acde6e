"""Triangles of somebody else's building, gathered with what they wear: pictures, or colours with a shade by which way they
face, so that the edges of an untextured building can be seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

MOST_TRIANGLES = 3_000_000  # of one file
MOST_SIDE_PX = 512  # of a picture; larger ones are made smaller: a hundred of them must fit into memory
LIGHT = np.array([0.36, 0.48, 0.8])  # where the shade of an untextured face comes from
GREY = (178, 178, 178)  # what nobody gave a colour
LEVELS = 16  # of each colour channel, with shade: few textures, and no edge between two that can be told from noise
SIDES = 32  # of a drawn circle


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles (N, 3, 3) in metres. uv (N, 3, 2) with the image (H, W, 3) that they wear, or colours (N, 3) uint8."""

    corners_m: np.ndarray
    colours: np.ndarray
    uv: np.ndarray | None = None
    image: np.ndarray | None = None

    def moved(self, matrix: np.ndarray) -> Part:
        """The same after a transform (4, 4)."""
        return replace(self, corners_m=self.corners_m @ matrix[:3, :3].T + matrix[:3, 3])

    def coloured(self, colour: tuple[int, int, int]) -> Part:
        """The same in one colour."""
        return replace(self, colours=np.broadcast_to(np.array(colour, np.uint8), (len(self.corners_m), 3)))

    def wearing(self, image: np.ndarray) -> Part:
        """The same with another picture; one that has no texture corners stays as it is."""
        return self if self.uv is None else replace(self, image=image)


def part(corners_m: np.ndarray, uv: np.ndarray | None = None) -> Part:
    """Grey triangles."""
    return Part(np.asarray(corners_m, float), np.broadcast_to(np.array(GREY, np.uint8), (len(corners_m), 3)), uv)


def box(size_m: np.ndarray) -> Part:
    """A box about the origin; each of its faces wears a whole picture."""
    half, quads = 0.5 * np.asarray(size_m, float), []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            quad = np.zeros((4, 3))
            one, other = (axis + 1) % 3, (axis + 2) % 3
            one, other = (one, other) if other == 2 or axis == 2 else (other, one)  # the picture's v goes up
            quad[:, axis] = sign * half[axis]
            quad[:, one] = np.array([-1, 1, 1, -1]) * half[one]
            quad[:, other] = np.array([-1, -1, 1, 1]) * half[other]
            quads.append(quad)
    return _of_quads(np.array(quads))


def _of_quads(quads: np.ndarray) -> Part:
    corners = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])[[[0, 1, 2], [0, 2, 3]]]
    return part(corners, np.tile(uv, (len(quads), 1, 1)))


def cylinder(radius_m: float, length_m: float, top: float = 1.0) -> Part:
    """A cylinder about the origin, upright, SIDES faces; its corners lie on it. top: share of the radius; 0: a cone."""
    turn = 2.0 * np.pi * np.arange(SIDES + 1) / SIDES
    ring, half = radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=1), 0.5 * length_m
    low, high = (np.column_stack([share * ring, np.full(SIDES + 1, z)]) for share, z in ((1.0, -half), (top, half)))
    sides = np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1)
    lids = [np.stack([end[:-1], end[1:], np.broadcast_to([0.0, 0.0, end[0, 2]], (SIDES, 3))], axis=1) for end in (low, high)]
    return part(np.concatenate([_of_quads(sides).corners_m, *lids]))


def sphere(radius_m: float) -> Part:
    """A sphere about the origin."""
    up, round_ = np.linspace(-0.5 * np.pi, 0.5 * np.pi, SIDES // 2 + 1), 2.0 * np.pi * np.arange(SIDES + 1) / SIDES
    grid = radius_m * np.stack([np.outer(np.cos(up), np.cos(round_)), np.outer(np.cos(up), np.sin(round_)),
                                np.outer(np.sin(up), np.ones(SIDES + 1))], axis=-1)
    quads = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2).reshape(-1, 4, 3)
    return part(_of_quads(quads).corners_m)


def sound(parts: list[Part]) -> list[Part]:
    """Parts without triangles that are none: not finite, or without area."""
    kept = []
    for one in parts:
        a, b, c = np.moveaxis(one.corners_m, 1, 0)
        good = np.isfinite(one.corners_m).all(axis=(1, 2))
        with np.errstate(invalid="ignore"):
            good &= np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-12
        if good.any():
            kept.append(Part(one.corners_m[good], one.colours[good], None if one.uv is None else one.uv[good], one.image))
    return kept


def dressed(parts: list[Part]) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Corners (N, 3, 3), texture corners (N, 3, 2), which image (N,), and the images of all parts together."""
    images: list[np.ndarray] = []
    numbers: dict[object, int] = {}
    uvs, textures = [], []
    for one in parts:
        if one.uv is not None and one.image is not None:
            key: object = id(one.image)
            if key not in numbers:
                numbers[key] = len(images)
                images.append(_smaller(one.image))
            uvs.append(np.nan_to_num(one.uv))
            textures.append(np.full(len(one.corners_m), numbers[key], np.int32))
            continue
        shades, which = np.unique(_shaded(one), axis=0, return_inverse=True)
        for shade in map(tuple, shades.tolist()):
            if shade not in numbers:
                numbers[shade] = len(images)
                images.append(np.full((1, 1, 3), shade, np.uint8))
        uvs.append(np.full((len(one.corners_m), 3, 2), 0.5))
        textures.append(np.array([numbers[tuple(shade)] for shade in shades.tolist()], np.int32)[which.ravel()])
    corners = np.concatenate([one.corners_m for one in parts])
    return corners, np.concatenate(uvs), np.concatenate(textures), tuple(images)


def _shaded(one: Part) -> np.ndarray:
    """(N, 3) uint8 colour of each face, darker the less it faces the light; a face has two sides that look the same."""
    a, b, c = np.moveaxis(one.corners_m, 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shade = 0.55 + 0.45 * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    step = 256.0 / LEVELS
    levels = np.minimum(np.floor(one.colours * shade[:, None] / step), LEVELS - 1)
    shaded: np.ndarray = (levels * step + 0.5 * step).astype(np.uint8)
    return shaded


def _smaller(image: np.ndarray) -> np.ndarray:
    import cv2

    scale = MOST_SIDE_PX / max(image.shape[:2])
    if scale >= 1.0:
        return image
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
