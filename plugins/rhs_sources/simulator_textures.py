"""Pictures on walls, floor and ceiling, drawn from a recipe and a seed.

Every surface has its own random generator, spawned from the seed and the surface's name: adding a wall does not change
the others. Images are (H, W, 3) uint8 RGB; row 0 is the top of a wall, or the north edge of a floor.
"""

from __future__ import annotations

import zlib

import cv2
import numpy as np

from rhs.api.floorplan import Paintings, Surface, Wall, World

MAX_SIDE_PX = 6000  # of one texture: a 40 m wall at 150 px/m; longer ones get coarser


def generator(seed: int, *names: str) -> np.random.Generator:
    """The random generator of a named thing."""
    return np.random.default_rng([seed, *(zlib.crc32(name.encode()) for name in names)])


def painting(rng: np.random.Generator, size_px: tuple[int, int]) -> np.ndarray:
    """One painting (H, W, 3) of `size_px` = (W, H): a gradient, overlapping shapes and strokes, grain, a frame."""
    w, h = size_px
    corners = rng.uniform(30, 230, (2, 2, 3)).astype(np.float32)
    image = np.clip(cv2.resize(corners, (w, h), interpolation=cv2.INTER_LINEAR), 0, 255).astype(np.uint8)
    for _ in range(int(rng.integers(14, 26))):
        _shape(rng, image)
    grain = noise(rng, (h, w), cells_px=(5, 17), amplitude=9.0)
    image = np.clip(image + grain[..., None], 0, 255).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    frame = max(2, h // 30)
    cv2.rectangle(image, (0, 0), (w - 1, h - 1), tuple(map(int, rng.integers(20, 110, 3))), frame)
    return image


def _shape(rng: np.random.Generator, image: np.ndarray) -> None:
    h, w = image.shape[:2]
    colour = tuple(map(int, rng.integers(0, 256, 3)))
    centre = rng.uniform((0, 0), (w, h))
    reach = rng.uniform(0.05, 0.28) * h
    kind = rng.integers(4)
    if kind == 0:
        axes = (int(reach), max(1, int(reach * rng.uniform(0.3, 1.0))))
        cv2.ellipse(image, tuple(map(int, centre)), axes, float(rng.uniform(0, 180)), 0, 360, colour, -1, cv2.LINE_AA)
    elif kind == 3:
        ends = np.clip(centre + rng.uniform(-2.5, 2.5, (2, 2)) * reach, 0, (w, h)).astype(int)
        cv2.line(image, ends[0].tolist(), ends[1].tolist(), colour, int(rng.integers(2, max(3, 2 + h // 16))), cv2.LINE_AA)
    else:
        corners = centre + rng.uniform(-1, 1, (int(rng.integers(3, 7)), 2)) * reach * 1.4
        cv2.fillPoly(image, [corners.astype(np.int32)], colour, cv2.LINE_AA)


def noise(rng: np.random.Generator, shape: tuple[int, int], *, cells_px: tuple[float, ...],
          amplitude: float) -> np.ndarray:
    """(H, W) float32 smooth noise, zero mean: one octave per cell size, finer ones weaker."""
    h, w = shape
    out = np.zeros(shape, np.float32)
    weights = np.sqrt(np.array(cells_px)) / np.sqrt(np.sum(cells_px))
    for cell, weight in zip(cells_px, weights, strict=True):
        coarse = rng.standard_normal((int(h / cell) + 2, int(w / cell) + 2), dtype=np.float32)
        octave: np.ndarray = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)
        octave *= np.float32(weight)
        out += octave
    out *= np.float32(amplitude)
    return out


def surface(rng: np.random.Generator, look: Surface, size_m: tuple[float, float], px_per_m: float) -> np.ndarray:
    """The bare surface (H, W, 3) of `size_m` = (width, height) after its recipe."""
    w, h = _pixels(size_m, px_per_m)
    px = w / size_m[0]
    shade = np.float32(look.roughness) * _PATTERNS[look.recipe](rng, (h, w), px)
    image, channel = np.empty((h, w, 3), np.uint8), np.empty_like(shade)
    for k, colour in enumerate(np.asarray(look.colour, np.float32)):  # three side by side take twice as long
        image[..., k] = np.clip(np.add(shade, colour, out=channel), 0, 255, out=channel)
    return _folded(image, look.fold)


def _pixels(size_m: tuple[float, float], px_per_m: float) -> tuple[int, int]:
    scale = min(px_per_m, MAX_SIDE_PX / max(size_m))
    return max(8, round(size_m[0] * scale)), max(8, round(size_m[1] * scale))


def _plaster(rng, shape, px):
    return noise(rng, shape, cells_px=(0.03 * px, 0.09 * px, 0.4 * px), amplitude=1.0)


def _carpet(rng, shape, px):
    blotches = noise(rng, shape, cells_px=(0.05 * px, 0.12 * px), amplitude=1.0)
    return np.clip(1.6 * blotches, -1.0, 1.0) + noise(rng, shape, cells_px=(0.6 * px,), amplitude=0.3)


def _wood(rng, shape, px):
    h, w = shape
    grain = noise(rng, (h, max(8, w // 6)), cells_px=(0.02 * px, 0.08 * px), amplitude=0.8)
    return cv2.resize(grain, (w, h), interpolation=cv2.INTER_LINEAR)


def _tiles(rng, shape, px, tile_m=(0.5, 0.5), shift=0.0):
    h, w = shape
    y, x = np.arange(h) / px / tile_m[1], np.arange(w) / px / tile_m[0]
    row = y.astype(int)
    tiles = np.arange(row.max() + 1)  # what follows of a row of tiles, not of each row of pixels: a tenth of the memory
    along = x + shift * (tiles % 2)[:, None]
    column = along.astype(int)
    tone = rng.standard_normal((len(tiles), column.max() + 1)).astype(np.float32)[tiles[:, None], column]
    upright = (along % 1.0) * tile_m[0] < 0.015
    joint = upright[row] | ((y % 1.0) * tile_m[1] < 0.015)[:, None]
    speckle = noise(rng, shape, cells_px=(0.03 * px, 0.1 * px), amplitude=0.8)
    speckle += (np.float32(0.7) * tone)[row]
    speckle[joint] = -2.0
    return speckle


def _brick(rng, shape, px):
    return _tiles(rng, shape, px, tile_m=(0.3, 0.12), shift=0.5)


def _plain(rng, shape, px):
    return np.zeros(shape, np.float32)


_PATTERNS = {"plaster": _plaster, "carpet": _carpet, "wood": _wood, "tiles": _tiles, "brick": _brick, "plain": _plain}


def _folded(image: np.ndarray, fold: int) -> np.ndarray:
    """The image made equal to itself after a turn by 360/fold degrees about its middle (fold 4: squares only)."""
    h, w = image.shape[:2]
    if fold == 2:
        image[h - h // 2 :] = image[: h // 2][::-1, ::-1]
    elif fold == 4:
        n = min(h, w) // 2
        quarter = image[:n, :n].copy()
        image = np.concatenate([np.concatenate([quarter, np.rot90(quarter, -1)], axis=1),
                                np.concatenate([np.rot90(quarter, 1), np.rot90(quarter, 2)], axis=1)], axis=0)
    return image


class WallPainter:
    """Hangs the paintings of a whole world: which one hangs where depends on the world and its seed alone."""

    def __init__(self, world: World, px_per_m: float) -> None:
        self.seed, self.paintings, self.px_per_m = world.seed, world.paintings, px_per_m
        self.hung = _hang(world)
        self.drawn: dict[int, np.ndarray] = {}

    def texture(self, wall: Wall, segment: int) -> np.ndarray:
        """(H, W, 3) of one straight piece of a wall, seen from the left-hand side: its first point is the right edge."""
        a, b = wall.points_m[segment : segment + 2]
        length = float(np.hypot(*(b - a)))
        look = wall.twins[segment] if wall.twins else segment
        rng = generator(self.seed, wall.name, str(look))
        image = surface(rng, wall.surface, (length, wall.height_m), self.px_per_m)
        px = image.shape[1] / length
        blanks = [blank for blank in wall.blanks if blank.segment == segment]
        for blank in blanks:
            left, right = max(0.0, length - blank.to_m), length - blank.from_m
            image[:, int(left * px) : int(right * px)] = np.asarray(wall.surface.colour, np.uint8)
        for middle_m, number in self.hung.get((wall.name, look), ()):
            picture = self._painting(number, px)
            half_m = 0.5 * picture.shape[1] / px
            if all(middle_m + half_m <= blank.from_m or middle_m - half_m >= blank.to_m for blank in blanks):
                _paste(image, picture, (length - middle_m) * px, (wall.height_m - self.paintings.middle_m) * px)
        return image

    def _painting(self, number: int, px: float) -> np.ndarray:
        if number not in self.drawn:
            rng = generator(self.seed, "painting", str(number))
            width, height = rng.uniform(*self.paintings.width_m), rng.uniform(*self.paintings.height_m)
            self.drawn[number] = painting(rng, (max(8, round(width * px)), max(8, round(height * px))))
        return self.drawn[number]


def _hang(world: World) -> dict[tuple[str, int], list[tuple[float, int]]]:
    """(wall, look) -> (metres along the wall, number of the painting) of all that hang there."""
    rng, settings = generator(world.seed, "hanging"), world.paintings
    middles_m: dict[tuple[str, int], list[float]] = {}
    for wall in world.walls:
        for segment, (a, b) in enumerate(wall.segments_m):
            key = (wall.name, wall.twins[segment] if wall.twins else segment)
            if wall.paintings and key not in middles_m:
                middles_m[key] = _places_along(rng, float(np.hypot(*(b - a))), settings)
    total = sum(map(len, middles_m.values()))
    numbers = rng.permutation(np.arange(total) % settings.unique)
    dealt = iter(numbers.tolist())
    return {key: [(middle, next(dealt)) for middle in middles] for key, middles in middles_m.items()}


def _places_along(rng: np.random.Generator, length_m: float, settings: Paintings) -> list[float]:
    count = int(length_m / settings.spacing_m)
    slack = max(0.0, 0.5 * (settings.spacing_m - settings.width_m[1]) - 0.05)
    middles = (np.arange(count) + 0.5) * length_m / max(count, 1) + rng.uniform(-slack, slack, count)
    kept = rng.random(count) < settings.density
    return middles[kept].tolist()


def _paste(image: np.ndarray, picture: np.ndarray, column: float, row: float) -> None:
    """Put the picture on the image, its middle at (column, row), cut at the edges."""
    h, w = picture.shape[:2]
    top, left = round(row - h / 2), round(column - w / 2)
    t, l_ = max(top, 0), max(left, 0)
    b, r = min(top + h, image.shape[0]), min(left + w, image.shape[1])
    if t < b and l_ < r:
        image[t:b, l_:r] = picture[t - top : b - top, l_ - left : r - left]
