"""How a tube bends, found from views taken inside it: nobody has to tell.

A tilt of the camera moves every ring of the wall alike; a bend moves a ring by the square of its distance. Two views some
way apart show the wall in relief, so that the middles of its rings say which of the two it is. For each view and an earlier
one almost a section's size behind it:

1. both views are opened, and points of the wall followed from one to the other;
2. both places, the points and the curvature ahead are fitted to where the points are seen, the points eliminated (bundle
   adjustment; Triggs, McLauchlan, Hartley and Fitzgibbon 2000, section 6.1);
3. what the pair says of the curvature, with the places eliminated too, is added to what other pairs said.

No state is carried from pair to pair but the way along and a loose idea of the place, so that a tilt once taken for a bend
does not stay one. The sum over all pairs is the plan by which the views are then unrolled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera

from .bending import KNOT, Profile, Winding
from .mosaic import Mosaic, shift_between
from .settings import Unrolling
from .unrolling import ALONG, ENOUGH, REMEMBERED, SEEN_SIZES, STRAYS, Unroller, View, seen_from

BASE = 0.8  # sizes between the views of a pair: less shows little relief, more and the near wall is no longer the same
KEPT = 25  # views remembered
ROUNDS = 5
NUDGE = 1e-5
PIXEL_SIGMA = 0.6  # of a followed point; twice that of one view, since a point is in the pairs of several
# How well the earlier place is known: left, up, and turned about x (which a round tube never shows), y and z.
EARLIER = np.array([0.05, 0.05, 0.02, 0.05, 0.05])
LATER = np.array([0.3, *STRAYS])  # and the later one, with the way between them
PLACES = len(EARLIER) + len(LATER)


class BendFinder:
    """Look at views in order; `winding` is the tube they show."""

    def __init__(self, settings: Unrolling, camera: Camera) -> None:
        self._settings, self._camera = settings, camera
        self.profile = Profile()
        self.profile.reach(SEEN_SIZES + 2.0)
        self._eye = Unroller(settings, camera, Winding(Unroller(settings, camera).section, self.profile.bends))
        self._past: list[View] = []
        self._step: float | None = None

    @property
    def winding(self) -> Winding:
        return Winding(self._eye.section, self.profile.bends)

    def look(self, picture: np.ndarray) -> None:
        """Take the next (H, W) gray view."""
        if not self._past:
            self._past = [(picture, self._eye.place.values.copy())]
            return
        last = self._past[-1][1]
        expected = self._expected(picture)
        earlier = next((p for p in reversed(self._past) if p[1][ALONG] <= expected[ALONG] - BASE), self._past[0])
        place = self._compared((picture, expected), earlier)
        self._step = float(place[ALONG] - last[ALONG])
        self._past = [*self._past, (picture, place)][-KEPT:]

    def _expected(self, picture: np.ndarray) -> np.ndarray:
        """The place (6,): a step on, put right by how the strip lies best on that of the last view."""
        last = self._past[-1]
        values = last[1].copy()
        values[1:] *= 1.0 - 1.0 / REMEMBERED
        values[ALONG] += self._step or 0.0
        below = Mosaic(self._settings.pixel_share, self._eye.section.perimeter_m)
        below.put(self._eye.strip(*last), np.eye(3))
        wide = self._settings.far_sizes - self._settings.near_sizes
        reach = 0.6 * wide if self._step is None else 0.25
        values[ALONG] += shift_between(self._eye.strip(picture, values), below, reach)[0]
        return values

    def _compared(self, later: View, earlier: View) -> np.ndarray:
        """The place of the later view; what the pair says of the curvature is noted."""
        wall, seen = self._eye.followed(later, earlier)
        seen = np.concatenate([self._eye.project(earlier[1], wall), seen], axis=1)
        known = np.isfinite(seen).all(axis=1)
        if known.sum() < ENOUGH:
            return later[1]
        wall, seen = wall[known], seen[known]
        self.profile.reach(float(wall[:, 0].max()) + 2.0)
        ahead = slice(max(int(earlier[1][ALONG] / KNOT), 0), int(np.ceil(wall[:, 0].max() / KNOT)) + 1)
        fit = PairFit(self.winding, self._camera, (earlier[1], later[1]), ahead)
        fit.run(wall, seen, *self.profile.prior(ahead))
        self.profile.add(ahead, *fit.says())
        self._eye.tube = self.winding
        return fit.later


@dataclass(frozen=True, eq=False)
class Linear:
    """Normal equations of a pair at some values: information (n, n) and vector (n,) of places and curvature, what was seen
    alone; by_x (N, 4, n) and back (N, 2, 4), which lead back to the points."""

    information: np.ndarray
    vector: np.ndarray
    by_x: np.ndarray
    back: np.ndarray


class PairFit:
    """Unknown: where two views were taken (5 and 6 numbers), the curvature ahead, and the points of the wall."""

    def __init__(self, winding: Winding, camera: Camera, places: tuple[np.ndarray, np.ndarray], ahead: slice) -> None:
        self._section, self._camera, self._ahead = winding.section, camera, ahead
        self.earlier, self.later, self.bends = places[0].copy(), places[1].copy(), winding.bends.copy()
        self._expected = np.concatenate([places[0][1:], places[1]])
        self._sure = 1.0 / np.concatenate([EARLIER, LATER]) ** 2

    def run(self, wall: np.ndarray, seen: np.ndarray, mean: np.ndarray, information: np.ndarray) -> None:
        """Fit points (N, 2) of the wall, seen (N, 4) at pixels of both; mean and information of the curvature beforehand."""
        for _ in range(ROUNDS):
            self._at = self._linear(wall, seen)
            whole, pull = self._at.information.copy(), self._at.vector.copy()
            whole[PLACES:, PLACES:] += information
            pull[PLACES:] += information @ (mean - self.bends[self._ahead])
            change = np.linalg.solve(whole, pull)
            self._said_at = self.bends[self._ahead].copy()
            gap = seen - self._predicted(wall) - self._at.by_x @ change
            wall = wall + np.clip(np.nan_to_num((self._at.back @ gap[:, :, None])[:, :, 0]), -0.3, 0.3)
            self.earlier[1:] += change[:5]
            self.later += change[5:PLACES]
            self.bends[self._ahead] += change[PLACES:]
            if np.abs(change).max() < 1e-4:
                break

    def says(self) -> tuple[np.ndarray, np.ndarray]:
        """Information of the curvature from this pair alone, places eliminated, and that times what it says."""
        whole, vector = self._at.information, self._at.vector
        solved = np.linalg.solve(whole[:PLACES, :PLACES], np.column_stack([whole[:PLACES, PLACES:], vector[:PLACES]]))
        information = whole[PLACES:, PLACES:] - whole[PLACES:, :PLACES] @ solved[:, :-1]
        information = 0.5 * (information + information.T)
        return information, vector[PLACES:] - whole[PLACES:, :PLACES] @ solved[:, -1] + information @ self._said_at

    def _linear(self, wall: np.ndarray, seen: np.ndarray) -> Linear:
        by_x, by_wall = self._slopes(wall)
        inner = np.swapaxes(by_wall, 1, 2) @ by_wall
        with np.errstate(invalid="ignore"):
            good = np.isfinite(by_x).all((1, 2)) & (np.abs(np.linalg.det(inner)) > 1e-9)
        inner[~good] = np.eye(2)
        by_x = np.where(good[:, None, None], by_x, 0.0)
        back = np.where(good[:, None, None], np.linalg.solve(inner, np.swapaxes(by_wall, 1, 2)), 0.0)
        gap = np.where(good[:, None], seen - self._predicted(wall), 0.0)
        aside = np.eye(4) - np.where(good[:, None, None], by_wall, 0.0) @ back  # what no place of the point can explain
        size = np.linalg.norm((aside @ gap[:, :, None])[:, :, 0], axis=1)
        scale = max(2.0 * float(np.median(size[good])), 0.3) if good.any() else 1.0
        good &= size < 4.0 * scale
        weight = good * np.minimum(1.0, scale / np.maximum(size, 1e-9)) / PIXEL_SIGMA**2
        turned = (aside @ by_x) * weight[:, None, None]
        information = np.einsum("nij,nik->jk", turned, by_x)
        vector = np.einsum("nij,ni->j", turned, gap)
        places = slice(0, PLACES)
        information[places, places] += np.diag(self._sure)
        vector[places] += self._sure * (self._expected - np.concatenate([self.earlier[1:], self.later]))
        return Linear(0.5 * (information + information.T), vector, by_x, back)

    def _predicted(self, wall: np.ndarray, earlier: np.ndarray | None = None, later: np.ndarray | None = None,
                   bends: np.ndarray | None = None) -> np.ndarray:
        """(N, 4) pixels in both views, at present values or at others."""
        winding = Winding(self._section, self.bends if bends is None else bends)
        places = (self.earlier if earlier is None else earlier, self.later if later is None else later)
        return np.concatenate([seen_from(winding, self._camera, place, wall) for place in places], axis=1)

    def _slopes(self, wall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(N, 4, n) of the pixels by places and curvature, (N, 4, 2) by the points."""
        now = self._predicted(wall)

        def nudged(values: np.ndarray, k: int) -> np.ndarray:
            out = values.copy()
            out[k] += NUDGE
            return out

        moved = [self._predicted(wall, earlier=nudged(self.earlier, k)) for k in range(1, 6)]
        moved += [self._predicted(wall, later=nudged(self.later, k)) for k in range(6)]
        moved += [self._predicted(wall, bends=nudged(self.bends, k)) for k in range(self._ahead.start, self._ahead.stop)]
        slid = [self._predicted(wall + np.eye(2)[k] * NUDGE) for k in (0, 1)]
        return tuple(np.stack([(m - now) / NUDGE for m in ms], axis=2) for ms in (moved, slid))  # type: ignore[return-value]
