"""Features of a view, computed once per observation and shared; matching; depth under a key-point.

SIFT (Lowe 2004) with OpenCV's precise up-scaling: without it every key-point sits a quarter of a pixel off
(opencv issue 23123), which turns into a steady drift in yaw. Descriptors are RootSIFT (Arandjelovic, Zisserman 2012).
This module is OpenCV's home in the core; OpenCV is imported at the first call and kept on one thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from rhs.api.files import replacing
from rhs.api.frozen import freeze
from rhs.api.records import FeatureAdvanced, Features, FeatureSettings, Observation, Thumbnail
from rhs.api.spare import granted, later
from rhs.base.errors import RhsError
from rhs.base.memory import keep_freed_memory

from .packed import rooted

# The image size that FeatureSettings.count is meant for.
REFERENCE_PX = 320 * 240
THUMBNAIL_COLUMNS = 80  # of a thumbnail: blocks of 4 by 4 pixels of a picture of 320 by 240

USUAL = FeatureAdvanced()

ORB_RATIO = 1.2  # of the sizes of two levels of ORB's pyramid

AHEAD = 8  # views that may lie between one whose key-points were asked for and one for which they are foreseen

_shared: WeakKeyDictionary[Observation, dict[Any, Callable[[], Features]]] = WeakKeyDictionary()
_asked: dict[Any, tuple[int, int]] = {}  # index of the view last asked about, how many in a row were
_foretold: dict[Any, int] = {}  # index of a view that will be asked about


def features(observation: Observation, settings: FeatureSettings) -> Features:
    """SIFT key-points of a view with RootSIFT descriptors (N, 128) float32 and camera-frame points.

    The same observation and settings give the same object. A view without key-points, or without an image, has N = 0.
    """
    return _remember(observation, settings)


def share(observation: Observation, settings: FeatureSettings, known: Features) -> None:
    """Let `features` answer with key-points that are known already: those of a recording that kept no images."""
    _shared.setdefault(observation, {}).setdefault(settings, lambda: known)


def orb_features(observation: Observation, count: int = 500) -> Features:
    """ORB key-points (Rublee 2011) with binary descriptors (N, 32) uint8: about five times faster than SIFT."""
    return _remember(observation, ("orb", count))


def foretell(settings: FeatureSettings, index: int) -> None:
    """Say that the key-points of the view with this index will be asked for, though not those of every view."""
    if granted():
        _foretold[settings] = index


def foresee(observation: Observation) -> None:
    """Where a processor is to spare, begin to find the key-points that were asked for of one view after the other, or that
    somebody said will be."""
    if not granted():
        return
    wanted = [key for key, (last, row) in _asked.items() if row >= 2 and 0 < observation.index - last <= AHEAD]
    told = [key for key, index in _foretold.items() if index == observation.index]
    for key in [*wanted, *told]:
        _foretold.pop(key, None)
        known = _shared.setdefault(observation, {})
        if key not in known:
            known[key] = later(partial(_found, observation, key))


def match(a: Features, b: Features, ratio: float, *, mutual: bool = True) -> np.ndarray:
    """(M, 2) integer pairs (row of a, row of b) that pass Lowe's ratio test, in the order of a.

    ratio: the nearest descriptor of b must be this much nearer than the second nearest. mutual: the row of a must also
    be the nearest to that row of b, so that no key-point is used twice. Fewer than two rows in b match nothing.
    """
    if len(a.descriptors) == 0 or len(b.descriptors) < 2:
        return np.empty((0, 2), int)
    distance = _distances(a.descriptors, b.descriptors)
    rows = np.arange(len(distance))
    nearest = distance.argmin(axis=1)
    first = distance[rows, nearest]
    distance[rows, nearest] = np.inf
    keep = first < ratio * distance.min(axis=1)
    distance[rows, nearest] = first
    if mutual:
        keep &= distance.argmin(axis=0)[nearest] == rows
    return np.stack([rows[keep], nearest[keep]], axis=1)


def gray(image: np.ndarray) -> np.ndarray:
    """(H, W) uint8 luminance of an (H, W, 3) RGB or (H, W) image."""
    return image if image.ndim == 2 else _cv2().cvtColor(image, _cv2().COLOR_RGB2GRAY)


def thumbnail(observation: Observation) -> Thumbnail | None:
    """The view in blocks, THUMBNAIL_COLUMNS of them side by side; None without an image."""
    if observation.image is None:
        return None
    image = gray(observation.image)
    height, width = image.shape
    size = (min(THUMBNAIL_COLUMNS, width), max(1, round(height * min(THUMBNAIL_COLUMNS, width) / width)))
    area = _cv2().INTER_AREA
    depth = np.full(size[::-1], np.nan, np.float32)
    if observation.depth is not None:
        known = np.where(observation.depth > 0, observation.depth, np.nan).astype(np.float32)
        depth = _cv2().resize(known, size, interpolation=area)
    return Thumbnail(_cv2().resize(image, size, interpolation=area), depth)


def depth_at(depth: np.ndarray, pixels: np.ndarray, s: FeatureAdvanced = USUAL) -> np.ndarray:
    """(N,) float64 metres along the optical axis at (N, 2) sub-pixel positions of an (H, W) depth image.

    On a plane inverse depth is linear in the pixel, so a plane is fitted to the inverse depths of the window around
    the pixel and read off at the exact position. NaN where too little is known, or where the window holds an edge.
    """
    inverse, known, offset = _windows(depth, pixels, s.window_half_px)
    share = known.mean(axis=1)
    basis = np.concatenate([np.ones((*offset.shape[:2], 1)), offset], axis=2)
    weighted = basis * known[:, :, None]
    normal = np.einsum("nki,nkj->nij", weighted, basis) + 1e-9 * np.eye(3)
    plane = np.linalg.solve(normal, np.einsum("nki,nk->ni", weighted, inverse)[:, :, None])[:, :, 0]
    residual = (np.einsum("nki,ni->nk", basis, plane) - inverse) * known
    rms = np.sqrt((residual**2).sum(axis=1) / np.maximum(known.sum(axis=1) - 3, 1))
    good = (share >= s.window_known) & (rms < s.edge_per_m) & (plane[:, 0] > 1e-3)
    return np.where(good, 1.0 / np.where(good, plane[:, 0], 1.0), np.nan)


def occlusion_distance(depth: np.ndarray, s: FeatureAdvanced = USUAL) -> np.ndarray:
    """(H, W) float32 pixels, within a few per cent, from each pixel to the nearest occlusion edge of an (H, W) depth
    image."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(depth > 0, 1.0 / depth, np.nan).astype(np.float32)
        smooth = np.ones(depth.shape, np.uint8)
        for rho, inner in ((inverse, smooth[1:-1]), (inverse.T, smooth.T[1:-1])):
            bend = rho[2:] + rho[:-2]
            bend -= 2.0 * rho[1:-1]
            inner &= ~(np.abs(bend, out=bend) > s.occlusion_per_m)
    if smooth.all():
        return np.full(depth.shape, np.inf, np.float32)
    distance: np.ndarray = _cv2().distanceTransform(smooth, _cv2().DIST_L2, _cv2().DIST_MASK_5)
    return distance


def _over_edges(depth: np.ndarray, pixels: np.ndarray, sizes: np.ndarray, s: FeatureAdvanced) -> np.ndarray:
    """(N,) bool: the patch of the key-point holds an occlusion edge. The centre of a key-point may lie past the rim."""
    column, row = np.clip(np.rint(pixels).astype(int), 0, np.array(depth.shape[::-1]) - 1).T
    over: np.ndarray = occlusion_distance(depth, s)[row, column] < s.patch_diameters * sizes
    return over


def _windows(depth: np.ndarray, pixels: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse depths (N, K), which are known (N, K), and pixel offsets (N, K, 2) from the key-point, of the windows."""
    reach = np.arange(-half, half + 1)
    dv, du = (grid.ravel() for grid in np.meshgrid(reach, reach, indexing="ij"))
    centre = np.rint(pixels).astype(int)
    u, v = centre[:, :1] + du, centre[:, 1:] + dv
    height, width = depth.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    values = depth[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
    known = inside & (values > 0)
    inverse = np.where(known, 1.0 / np.where(known, values, 1.0), 0.0)
    return inverse, known, np.stack([u - pixels[:, :1], v - pixels[:, 1:]], axis=2)


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, M) float32 distances: Euclidean between unit float rows, Hamming between uint8 rows."""
    if a.dtype == np.uint8:
        bits_a, bits_b = (np.unpackbits(rows, axis=1).astype(np.float32) for rows in (a, b))
        distances: np.ndarray = bits_a.sum(axis=1)[:, None] + bits_b.sum(axis=1)[None, :] - 2.0 * bits_a @ bits_b.T
    else:
        distances = np.sqrt(np.maximum(2.0 - 2.0 * a @ b.T, 0.0))
    return distances


def _remember(observation: Observation, key: Any) -> Features:
    last, row = _asked.get(key, (-1, 0))
    if observation.index != last:
        _asked[key] = observation.index, row + 1 if observation.index == last + 1 else 1
    known = _shared.setdefault(observation, {})
    if key not in known:
        found = _found(observation, key)
        known[key] = lambda: found
    return known[key]()


def _found(observation: Observation, key: Any) -> Features:
    return _sift(observation, key) if isinstance(key, FeatureSettings) else _orb(observation, key[1])


def _sift(observation: Observation, settings: FeatureSettings) -> Features:
    pixels = 0 if observation.image is None else observation.image.shape[0] * observation.image.shape[1]
    detector = _detector("sift", max(1, round(settings.count * pixels / REFERENCE_PX)), settings.contrast)
    shrunk = max(1, int(np.sqrt(pixels / settings.advanced.sift_px)))
    pixels, sizes, descriptors = _detect(observation, detector, np.empty((0, 128), np.float32), shrunk=shrunk)
    sift = descriptors.astype(np.uint8)  # whole numbers, which OpenCV hands out as floats
    found = _lifted(observation, (pixels, sizes, rooted(sift)), settings.advanced)
    return replace(found, thumbnail=freeze(thumbnail(observation)), sift=freeze(sift))


def _orb(observation: Observation, count: int) -> Features:
    found = _detect(observation, _detector("orb", count, 0.0), np.empty((0, 32), np.uint8), ratio=ORB_RATIO)
    return _lifted(observation, found, USUAL)


def _detect(
    observation: Observation, detector: Any, none: np.ndarray, *, ratio: float = 1.0, shrunk: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (N, 2) float32, diameters (N,) in pixels, descriptors (N, D); `none`: the descriptors of an empty view.

    ratio: of the sizes of two levels of a pyramid whose pixels the detector scales from the corner of the image; the
    middle of a pixel lies elsewhere, so key-points of coarse levels are put right: without it ORB drifts in yaw. shrunk:
    so many times smaller the image is made before."""
    empty = np.empty((0, 2), np.float32), np.empty(0), none
    if observation.image is None:
        return empty
    key_points, descriptors = detector.detectAndCompute(_smaller(gray(observation.image), shrunk), None)
    if not key_points:  # KeyPoint_convert returns a tuple then, and the descriptors are None
        return empty
    pixels = _cv2().KeyPoint_convert(key_points)
    if ratio != 1.0:
        level = np.array([point.octave for point in key_points])
        pixels = pixels + (0.5 * (ratio**level - 1.0))[:, None].astype(np.float32)
    if shrunk > 1:
        pixels = (pixels + np.float32(0.5)) * np.float32(shrunk) - np.float32(0.5)
    return pixels, shrunk * np.array([point.size for point in key_points]), descriptors


def _smaller(image: np.ndarray, times: int) -> np.ndarray:
    """(H, W) image with means over squares of so many pixels."""
    if times == 1:
        return image
    height, width = (side // times for side in image.shape)
    smaller: np.ndarray = _cv2().resize(image[: height * times, : width * times], (width, height),
                                        interpolation=_cv2().INTER_AREA)
    return smaller


def _lifted(
    observation: Observation, found: tuple[np.ndarray, np.ndarray, np.ndarray], s: FeatureAdvanced
) -> Features:
    """Depth is looked up at the raw pixel; only the ray is undistorted. found: pixels, diameters, descriptors."""
    pixels, sizes, descriptors = found
    points = np.full((len(pixels), 3), np.nan, np.float32)
    if observation.depth is not None and len(pixels):
        exact = pixels.astype(float)
        depth = depth_at(observation.depth, exact, s)
        over_edge = _over_edges(observation.depth, pixels, sizes, s) & np.isfinite(depth)
        if over_edge.sum() <= s.few_over_edges * np.isfinite(depth).sum():
            depth[over_edge] = np.nan
        points = observation.camera.points(exact, depth).astype(np.float32)
    for array in (pixels, descriptors, points):
        array.setflags(write=False)
    return Features(pixels, descriptors, points)


@cache
def _detector(kind: str, count: int, contrast: float) -> Any:
    if kind == "orb":
        return _cv2().ORB_create(nfeatures=count, scaleFactor=ORB_RATIO)
    return _cv2().SIFT_create(nfeatures=count, contrastThreshold=contrast, enable_precise_upscale=True)


@cache
def _cv2() -> Any:
    import cv2

    keep_freed_memory()
    cv2.setNumThreads(1)  # results and timings must not depend on the number of cores
    return cv2


def write_image(path: Path, image: np.ndarray) -> None:
    """Write an (H, W, 3) uint8 RGB image as PNG; the file appears whole or not at all."""
    import cv2

    ok, data = cv2.imencode(".png", cv2.cvtColor(np.asarray(image), cv2.COLOR_RGB2BGR))
    if not ok:
        raise RhsError(f"OpenCV could not encode {path.name} ({image.shape}, {image.dtype}) as PNG")
    with replacing(path, "wb") as file:
        file.write(data.tobytes())
