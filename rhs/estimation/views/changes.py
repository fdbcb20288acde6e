"""What is otherwise in a picture than in earlier ones of the same place: by depth, both ways, and by colour.

A ray that went through a point before and ends there now found something new; one that ended there before and goes on now
misses something (free-space reasoning over registered depth, as in Herbst, Henry and Fox 2011, "Toward online 3-D object
segmentation and mapping"). Where the surface is the same, colours are compared after the light is taken out: per direction
that surfaces face, the median ratio of brightness and shift of chroma. Everything is compared with a neighbourhood, so that
an error of the registration of a pixel or two marks nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from rhs.api.geometry import Camera, inverse, transform

from .change_settings import ChangeSettings
from .rigid import PointNoise

USUAL = ChangeSettings()
NEW, GONE, DIFFERENT = "new", "gone", "looks different"
DARK = 12.0  # grey levels below which colour is mostly noise
BRIGHT = 250.0  # grey levels from which on a pixel may be saturated
FACING = 8  # bins of the compass for the direction an upright surface faces; two more for floors and ceilings
BESIDE_PX = 15  # what came or went shades and hides what is within half of this round it
SAME_M = 0.3  # regions of one kind nearer than this, middle to middle, are one


@dataclass(frozen=True, eq=False)
class Sight:
    """A picture with its depth. image (H, W, 3) uint8 RGB; depth (H, W) float32 metres along the optical axis, NaN unknown;
    camera: of these pixels; map_from_body: 4x4 pose from which it was taken."""

    image: np.ndarray
    depth: np.ndarray
    camera: Camera
    map_from_body: np.ndarray

    @property
    def map_from_camera(self) -> np.ndarray:
        """4x4 pose of the camera."""
        pose: np.ndarray = self.map_from_body @ self.camera.body_from_camera
        return pose

    @cached_property
    def points_m(self) -> np.ndarray:
        """(H * W, 3) what each pixel shows, in the map; NaN where depth is unknown."""
        return self.some_points_m(1)

    def some_points_m(self, stride: int) -> np.ndarray:
        """The same of every so many pixels, across and down."""
        depth = self.depth[::stride, ::stride].ravel().astype(float)
        rows, columns = np.mgrid[: self.depth.shape[0] : stride, : self.depth.shape[1] : stride]
        pixels = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
        return transform(self.map_from_camera, self.camera.points(pixels, depth))

    @cached_property
    def normals(self) -> np.ndarray:
        """(H, W, 3) unit normals of what each pixel shows, from the neighbours three pixels off; NaN at the rim and where
        depth jumps or is unknown."""
        points = self.points_m.reshape(*self.depth.shape, 3)
        right, down = np.full_like(points, np.nan), np.full_like(points, np.nan)
        right[:, 3:-3], down[3:-3] = points[:, 6:] - points[:, :-6], points[6:] - points[:-6]
        normal = np.cross(right, down)
        with np.errstate(invalid="ignore", divide="ignore"):
            normal /= np.linalg.norm(normal, axis=2, keepdims=True)
            bend = np.abs(((points[:, 6:] + points[:, :-6] - 2.0 * points[:, 3:-3]) * normal[:, 3:-3]).sum(axis=2))
            normal[:, 3:-3][~(bend < 0.1)] = np.nan
        return normal


@dataclass(frozen=True, eq=False)
class Change:
    """verdict: new, gone or looks different. points_m (N, 3): what was found or missed, in the map; width_m and height_m of
    it as seen; at_m (3,): its middle; pixels: how many it covers."""

    verdict: str
    points_m: np.ndarray
    width_m: float
    height_m: float
    at_m: np.ndarray
    pixels: int

    @property
    def size_m(self) -> float:
        """Its longer side."""
        return max(self.width_m, self.height_m)

    def outline(self, sight: Sight) -> np.ndarray:
        """(N, 2) convex outline in the pixels of a picture; N = 0 where it cannot be seen from there."""
        pixels = sight.camera.project(transform(inverse(sight.map_from_camera), self.points_m))
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        width, height = sight.camera.width, sight.camera.height
        inside = ((pixels >= -0.5) & (pixels < (width - 0.5, height - 0.5))).all(axis=1)
        if inside.sum() < 3:
            return np.zeros((0, 2))
        hull: np.ndarray = cv2.convexHull(np.clip(pixels, 0, (width - 1, height - 1)).astype(np.float32))[:, 0].astype(float)
        return hull


def compare(now: Sight, before: Sequence[Sight], settings: ChangeSettings = USUAL) -> list[Change]:
    """What changed in `now` against pictures taken `before`, all registered in one map; largest first."""
    passed, same, differs = np.zeros((3, *now.depth.shape), bool)
    compared = np.zeros(now.depth.shape, bool)
    for earlier in before:
        nearer, surface = rays_end(now, earlier, settings)
        otherwise = colours_differ(now, earlier, surface, settings)
        passed |= nearer
        differs = np.where(surface, np.where(compared, differs & otherwise, otherwise), differs)
        same, compared = same | surface, compared | surface
    new = _regions(NEW, now, passed & ~same, settings)
    gone = [change for number, earlier in enumerate(before)
            for change in _regions(GONE, earlier, _missed(now, before, number, settings), settings)]
    structure = _distinct(new) + _distinct(gone)
    looks = _regions(DIFFERENT, now, differs & ~_near(now, structure), settings)
    return sorted(structure + looks, key=lambda change: -change.size_m)


def rays_end(sight: Sight, other: Sight, settings: ChangeSettings) -> tuple[np.ndarray, np.ndarray]:
    """(nearer, same), each (H, W) bool of `sight`: the other's rays went on past the surface of this pixel; they ended on
    it. Both False: not seen from there, hidden, or of unknown depth."""
    z_m, rows, columns = _landing(sight, other)
    nearest, furthest = _window(other.depth, settings.slack_px)
    nearest_m, furthest_m = nearest[rows, columns], furthest[rows, columns]
    noise = PointNoise(sight.camera.fx)
    tolerance = settings.depth_m + settings.depth_sigmas * np.sqrt(2.0) * noise.depth(np.nan_to_num(z_m, nan=1.0))
    with np.errstate(invalid="ignore"):
        nearer: np.ndarray = np.asarray(z_m < nearest_m - tolerance)
        between: np.ndarray = np.asarray((z_m > nearest_m - tolerance) & (z_m < furthest_m + tolerance))
    same = between & np.isfinite(other.depth[rows, columns])
    return nearer.reshape(sight.depth.shape), same.reshape(sight.depth.shape)


def colours_differ(now: Sight, earlier: Sight, surface: np.ndarray, settings: ChangeSettings) -> np.ndarray:
    """(H, W) bool of `now`: the same surface (bool (H, W)) does not look as it did, whatever the light."""
    _, rows, columns = _landing(now, earlier)
    slack = np.ones((2 * settings.slack_px + 1,) * 2, np.uint8)
    ours, theirs = _looks(now.image), _looks(earlier.image)
    fair = surface & _fair(now.image) & _fair(earlier.image)[rows, columns].reshape(surface.shape)
    facing, out = _facing(now), np.zeros(surface.shape, bool)
    limits = np.array([settings.brightness_log, settings.chroma, settings.chroma, settings.chroma])
    for channel, limit in enumerate(limits):
        here, there = ours[..., channel], theirs[..., channel]
        low, high, middle = (image[rows, columns].reshape(surface.shape) for image in
                             (cv2.erode(there, slack), cv2.dilate(there, slack), cv2.blur(there, (3, 3))))
        shift = _shift_by_facing(here - there[rows, columns].reshape(surface.shape), fair, facing)
        here_now = here - shift
        out |= _beyond(cv2.blur(here_now, (3, 3)), low, high, limit)
        out |= _beyond(middle, cv2.erode(here_now, slack), cv2.dilate(here_now, slack), limit)
    different: np.ndarray = out & fair
    return different


def _beyond(value: np.ndarray, low: np.ndarray, high: np.ndarray, limit: float) -> np.ndarray:
    return (value > high + limit) | (value < low - limit)


def _missed(now: Sight, before: Sequence[Sight], number: int, settings: ChangeSettings) -> np.ndarray:
    """(H, W) bool of picture `number` from before: the rays of now go on past it, and those of no other from before did."""
    earlier = before[number]
    missed, _ = rays_end(earlier, now, settings)
    for other in [*before[:number], *before[number + 1 :]]:
        missed &= ~rays_end(earlier, other, settings)[0]
    return missed


def _landing(sight: Sight, other: Sight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the surface of each pixel (H * W) would be seen in the other picture: depth in metres (NaN: not in it), row and
    column of the nearest pixel."""
    points = transform(inverse(other.map_from_camera), sight.points_m)
    x, y = other.camera.project(points).T
    height, width = other.depth.shape
    with np.errstate(invalid="ignore"):
        inside = (x >= -0.5) & (x < width - 0.5) & (y >= -0.5) & (y < height - 0.5)
    columns, rows = (np.where(inside, np.rint(at), 0.0).astype(int) for at in (x, y))
    return np.where(inside, points[:, 2], np.nan), rows, columns


def _window(depth: np.ndarray, slack_px: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest depth round each pixel, of those known; NaN where none is."""
    slack = np.ones((2 * slack_px + 1,) * 2, np.uint8)
    known = np.isfinite(depth)
    nearest = cv2.erode(np.where(known, depth, np.inf).astype(np.float32), slack, borderValue=float("inf"))
    furthest = cv2.dilate(np.where(known, depth, -np.inf).astype(np.float32), slack, borderValue=float("-inf"))
    none = ~np.isfinite(nearest)
    return np.where(none, np.nan, nearest), np.where(none, np.nan, furthest)


def _looks(image: np.ndarray) -> np.ndarray:
    """(H, W, 4) float32: logarithm of brightness, and the shares of red, green and blue; lightly smoothed."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (3, 3), 0) + np.float32(1.0)
    total = smooth.sum(axis=2, keepdims=True)
    return np.concatenate([np.log(total), smooth / total], axis=2).astype(np.float32)


def _fair(image: np.ndarray) -> np.ndarray:
    """(H, W) bool: neither too dark nor too bright to tell a colour."""
    fair: np.ndarray = (image.mean(axis=2) > DARK) & (image.max(axis=2) < BRIGHT)
    return fair


def _facing(sight: Sight) -> np.ndarray:
    """(H, W) int: the direction the surface of each pixel faces, in bins."""
    points = sight.points_m.reshape(*sight.depth.shape, 3)
    right, down = np.zeros_like(points), np.zeros_like(points)
    right[:, 2:-2], down[2:-2] = points[:, 4:] - points[:, :-4], points[4:] - points[:-4]
    normal = np.nan_to_num(np.cross(right, down))
    level = np.hypot(normal[..., 0], normal[..., 1])
    compass = np.floor((np.arctan2(normal[..., 1], normal[..., 0]) / (2.0 * np.pi) + 0.5 / FACING) * FACING) % FACING
    bins: np.ndarray = np.where(level > np.abs(normal[..., 2]), compass, np.where(normal[..., 2] > 0, FACING, FACING + 1))
    return bins.astype(int)


def _shift_by_facing(difference: np.ndarray, fair: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """(H, W) float32: the median difference of all that face the same way; what the light did to them."""
    shift = np.full(difference.shape, np.median(difference[fair]) if fair.any() else 0.0, np.float32)
    for which in np.unique(facing[fair]):
        alike = facing == which
        shift[alike] = np.median(difference[alike & fair])
    return shift


def _regions(verdict: str, sight: Sight, marked: np.ndarray, settings: ChangeSettings) -> list[Change]:
    """The connected regions of marked pixels that are large enough, in pixels and in metres."""
    solid = cv2.morphologyEx(marked.astype(np.uint8), cv2.MORPH_OPEN, np.ones((settings.narrow_px,) * 2, np.uint8))
    solid = cv2.morphologyEx(solid, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, areas, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    points, found = sight.points_m, []
    for number in range(1, count):
        mine = points[(labels == number).ravel()]
        mine = mine[np.isfinite(mine).all(axis=1)]
        if areas[number, cv2.CC_STAT_AREA] < settings.least_px or len(mine) < 3:
            continue
        change = _measured(verdict, mine)
        if change.size_m >= settings.least_m:
            found.append(change)
    return found


def _measured(verdict: str, points_m: np.ndarray) -> Change:
    """Its size as seen: level along its longer way and up, without the outermost fortieth on each side."""
    level = points_m[:, :2] - points_m[:, :2].mean(axis=0)
    along = np.linalg.eigh(level.T @ level)[1][:, 1]
    low, high = np.percentile(np.column_stack([level @ along, points_m[:, 2]]), (2.5, 97.5), axis=0)
    width_m, height_m = (high - low) / 0.95
    return Change(verdict, points_m, float(width_m), float(height_m), np.median(points_m, axis=0), len(points_m))


def _distinct(changes: list[Change]) -> list[Change]:
    """The same thing seen in several pictures counts once, as the largest of them."""
    kept: list[Change] = []
    for change in sorted(changes, key=lambda change: -change.size_m):
        if all(np.linalg.norm(change.at_m - other.at_m) > max(SAME_M, 0.5 * other.size_m) for other in kept):
            kept.append(change)
    return kept


def _near(now: Sight, structure: list[Change]) -> np.ndarray:
    """(H, W) bool: what came or went covers or uncovers this."""
    near = np.zeros(now.depth.shape, np.uint8)
    for change in structure:
        outline = change.outline(now)
        if len(outline) >= 3:
            cv2.fillConvexPoly(near, np.rint(outline).astype(np.int32), 1)
    return cv2.dilate(near, np.ones((BESIDE_PX,) * 2, np.uint8)).astype(bool)
