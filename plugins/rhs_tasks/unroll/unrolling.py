"""Unrolling: views from inside a tube to one flat picture of its wall, a strip per view.

Each view is back-projected on the section where it is believed to be, which gives a strip of the wall between `near` and
`far` ahead (thesis section 4.3, Figure 4.4). Where that is, an extended Kalman filter follows with the thesis's measurement
(eq. 4.6): points of the last view, back-projected on the section and projected into this one. The strip is then stitched on
by the homography that carries it to the mosaic so far.

Deviations from the thesis: places are relative to the section, so that a tube may be as long as it likes; it may bend, as it
is told or as rhs.bend_finder found. `pose=centred` keeps the camera on the axis; the homography has to absorb all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, exp_so3
from rhs.estimation.filters.kalman import correct_information, numeric_jacobian
from rhs.worlds.tubes import RectangularSection, RoundSection, Tube

from .bending import Winding
from .mosaic import Mosaic, Strip, follow, homography, sample, shift_between
from .settings import Unrolling

# A place: along the tube, left of and above the middle (sizes), turned by a rotation vector against the section (rad).
# All lengths here are in sizes of the section.
ALONG, AT = 0, slice(1, 6)
STATES = 6
View = tuple[np.ndarray, np.ndarray]  # a picture (H, W), and where it was taken (6,)
# A camera is led near the middle and along the tube: how far it strays (1 sigma), and in how many views it strays elsewhere.
STRAYS = np.array([0.1, 0.1, 0.1, 0.1, 0.1])
REMEMBERED = 15.0
STEP_SIGMA = 0.3  # how wrong the length of a step may be, sizes
ENOUGH = 20  # followed points; fewer, and the strip goes where it was expected
SEEN_SIZES = 8.0  # points up to so far ahead say where the tube goes; further off they are too small
LOOK = (256, 128)  # rows round the tube and columns ahead on which two views are compared
PIXEL_SIGMA = 0.3  # of a followed point
MOST_PX = {"fitted": 4.0, "centred": 30.0}  # of the mosaic, that a homography may move a point of a strip


@dataclass(frozen=True, eq=False)
class Place:
    """Where a view was taken (6,), and the covariance (5, 5) of all but the way along."""

    values: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Stitched:
    """One strip: along_m of its view; points followed from the last view; rms of their fit, px; correlation with the
    mosaic where they overlap, NaN for the first; registered: enough points agreed; values (6,) of the place."""

    along_m: float
    points: int
    residual_px: float
    agreement: float
    registered: bool
    values: np.ndarray


class Unroller:
    """Takes gray views in order; `mosaic` grows."""

    def __init__(self, settings: Unrolling, camera: Camera, tube: Tube | Winding | None = None) -> None:
        """tube: in sizes of the section; None: as the settings have it."""
        self._settings, self._camera, self._size_m = settings, camera, settings.size_m
        self.tube = tube or tube_of(settings)
        self.section = self.tube.section
        self.mosaic = Mosaic(settings.pixel_share, self.section.perimeter_m)
        start = np.zeros(STATES)
        start[1:3] = np.array([settings.start_left_m, settings.start_up_m]) / settings.size_m
        self.place = Place(start, 0.02**2 * np.eye(5))
        self._step: float | None = None
        self._last: np.ndarray | None = None

    def add(self, picture: np.ndarray) -> Stitched:
        """Unrolling one (H, W) gray view and stitch it on."""
        place, points, residual = self.place, 0, np.nan
        if self._last is not None:
            place, points, residual = self._moved(picture, self._last)
        strip = self.strip(picture, place.values)
        warp, agreed = np.eye(3), 0
        if self._settings.stitch == "homography" and not self.mosaic.empty:
            under = self.mosaic.part(strip.first, strip.grey.shape[1])
            warp, agreed = homography(*follow(strip, *under), MOST_PX[self._settings.pose])
        registered = self._last is None or max(points, agreed) >= ENOUGH
        agreement = self.mosaic.put(strip, warp)
        self._step = None if self._last is None else float(place.values[ALONG] - self.place.values[ALONG])
        self.place, self._last = place, picture
        along_m = float(place.values[ALONG]) * self._size_m
        return Stitched(along_m, max(points, agreed), residual, agreement, registered, place.values)

    def _moved(self, picture: np.ndarray, last: np.ndarray) -> tuple[Place, int, float]:
        """The place of this view: as far on as the last step took, put right by how the strip lies best on the last view,
        then by the filter."""
        values = self.place.values.copy()
        keep = 1.0 - 1.0 / REMEMBERED if self._settings.pose == "fitted" else 0.0
        values[1:] *= keep
        values[ALONG] += self._step or 0.0
        wide = self._settings.far_sizes - self._settings.near_sizes
        shift = shift_between(self.strip(picture, values), self.mosaic, 0.6 * wide if self._step is None else 0.25)
        values[ALONG] += shift[0]
        if self._settings.pose == "centred":
            return Place(values, self.place.covariance), 0, np.nan
        fresh = keep**2 * self.place.covariance + np.diag((1.0 - keep**2) * STRAYS**2)
        return self._filtered(picture, last, Place(values, fresh), keep)

    def _filtered(self, picture: np.ndarray, last: np.ndarray, expected: Place, keep: float) -> tuple[Place, int, float]:
        """The update of eq. 4.6: states are the last place (without the way), this place and the step."""
        wall, seen = self.followed((picture, expected.values), (last, self.place.values))
        if len(wall) < ENOUGH:
            return expected, len(wall), np.nan
        before = self._by_last(wall)
        covariance = np.zeros((11, 11))  # last place 0-4, this place 5-9, step 10
        covariance[:5, :5], covariance[5:10, 5:10] = self.place.covariance, expected.covariance
        covariance[:5, 5:10] = covariance[5:10, :5] = keep * self.place.covariance
        covariance[10, 10] = STEP_SIGMA**2
        values, delta = expected.values, np.zeros(11)
        for _ in range(4):
            now = self._by_place(values, wall)
            by_wall = self._by_wall(values, wall)
            rows = np.concatenate([by_wall @ before, now[:, :, AT], now[:, :, :1]], axis=2)
            gap = seen - self.project(values, wall) - (by_wall @ before) @ delta[:5]
            size = np.linalg.norm(gap, axis=1)
            scale = max(2.0 * float(np.nanmedian(size)), PIXEL_SIGMA)
            good = np.isfinite(rows).all((1, 2)) & (size < 4.0 * scale)
            weight = np.minimum(1.0, scale / np.maximum(size[good], 1e-9)) / PIXEL_SIGMA**2
            stacked, pull = rows[good].reshape(-1, 11), np.repeat(weight, 2)
            innovation = gap[good].ravel() + stacked @ delta
            change = correct_information(covariance, (stacked.T * pull) @ stacked, stacked.T @ (pull * innovation))
            delta = change.delta
            values = expected.values + np.concatenate([delta[10:], delta[5:10]])
        near = size < 2.0 * scale
        return Place(values, change.covariance[5:10, 5:10]), int(near.sum()), float(np.sqrt(np.mean(size[near] ** 2)))

    def followed(self, this: View, last: View) -> tuple[np.ndarray, np.ndarray]:
        """Points of the wall (N, 2) as the last view saw them, and their pixels (N, 2) in this one.

        Both views are opened on one grid before points are followed: what is left is small and does not grow from view to
        view as a picture does when one goes forward, which would pull the points along. Columns are even in the picture."""
        (picture, expected), (before, values) = this, last
        middle = 0.5 * (values[ALONG] + expected[ALONG])
        along = middle + 1.0 / np.linspace(1.0 / self._settings.near_sizes, 1.0 / SEEN_SIZES, LOOK[1])
        around = (np.arange(LOOK[0]) + 0.5) * self.section.perimeter_m / LOOK[0]
        wall = np.stack([a.ravel() for a in np.meshgrid(along, around)], axis=1)
        (grey, known), (now, seen) = self._open(before, values, wall), self._open(picture, expected, wall)
        here, there = follow(Strip(0, now, seen.astype(float)), grey, known)

        def lifted(pixels: np.ndarray) -> np.ndarray:
            columns = np.interp(pixels[:, 0], np.arange(LOOK[1]), along)
            return np.stack([columns, (pixels[:, 1] + 0.5) * self.section.perimeter_m / LOOK[0]], axis=1)

        return lifted(there), self.project(expected, lifted(here))

    def _open(self, picture: np.ndarray, values: np.ndarray, wall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """grey and seen of the LOOK grid of the wall in a view taken at a place."""
        return sample(picture, self.project(values, wall).reshape(*LOOK, 2))

    def _by_last(self, wall: np.ndarray) -> np.ndarray:
        """(N, 2, 5): how the wall's point behind a pixel of the last view moves with where that view was taken."""
        by_place, by_wall = self._by_place(self.place.values, wall), self._by_wall(self.place.values, wall)
        with np.errstate(invalid="ignore"):
            singular = ~(np.abs(np.linalg.det(by_wall)) > 1e-9)
        by_wall[singular] = np.eye(2)
        out = -np.linalg.solve(by_wall, by_place[:, :, AT])
        out[singular] = np.nan
        return out

    def _by_place(self, values: np.ndarray, wall: np.ndarray) -> np.ndarray:
        return numeric_jacobian(lambda x: self.project(x, wall).ravel(), values, 1e-5).reshape(-1, 2, STATES)

    def _by_wall(self, values: np.ndarray, wall: np.ndarray) -> np.ndarray:
        """(N, 2, 2) of pixels by along and around."""
        nudges = np.diag([1e-5, 1e-5])
        columns = [(self.project(values, wall + n) - self.project(values, wall - n)) / 2e-5 for n in nudges]
        return np.stack(columns, axis=2)

    def strip(self, picture: np.ndarray, values: np.ndarray) -> Strip:
        """The wall between near and far ahead of the view, as seen from a place, on the mosaic's own grid."""
        first = int(np.ceil((values[ALONG] + self._settings.near_sizes) / self.mosaic.pixel))
        count = int((self._settings.far_sizes - self._settings.near_sizes) / self.mosaic.pixel)
        flat = self.mosaic.grid(first, count)
        shape = (self.mosaic.rows, count)
        grey, inside = sample(picture, self.project(values, flat).reshape(*shape, 2))
        ahead = np.maximum(flat[:, 0] - values[ALONG], 0.1).reshape(shape)
        return Strip(first, grey, np.where(inside, ahead**-6.0, 0.0))  # resolution along the wall falls as its square

    def project(self, values: np.ndarray, wall: np.ndarray) -> np.ndarray:
        """(N, 2) pixels of points (N, 2) of the wall (along, around) seen from a place; NaN behind the camera."""
        return seen_from(self.tube, self._camera, values, wall)


def seen_from(tube: Tube | Winding, camera: Camera, values: np.ndarray, wall: np.ndarray) -> np.ndarray:
    """(N, 2) pixels of points (N, 2) of the wall of a tube seen from a place (6,); NaN behind the camera."""
    section = tube.pose(float(values[ALONG]))
    points = (tube.points(wall[:, 0], wall[:, 1]) - section[:3, 3]) @ section[:3, :3]
    body = (points - np.array([0.0, values[1], values[2]])) @ exp_so3(values[3:6])
    return camera.project(body @ BODY_FROM_OPTICAL)


def tube_of(settings: Unrolling) -> Tube:
    """The tube of the settings in sizes of its section."""
    section = RoundSection(1.0) if settings.shape == "round" else RectangularSection(1.0, settings.aspect)
    pairs = zip(settings.pieces[::2], settings.pieces[1::2], strict=True)
    return Tube(section, tuple((length_m / settings.size_m, np.radians(bend) * settings.size_m / length_m)
                               for length_m, bend in pairs))
