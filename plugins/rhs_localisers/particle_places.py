"""What stored views tell a particle filter: likeness everywhere, and now and then verified places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import planar, se2, wrap
from rhs.api.grid import OccupancyGrid
from rhs.api.jit import compiled
from rhs.api.records import Observation, Scan, View
from rhs.estimation.filters.particles import around
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.views.explainability import expected
from rhs.estimation.views.features import features
from rhs.estimation.views.place_database import PlaceDatabase, shares
from rhs.estimation.views.place_memory import Memory, memory_of
from rhs.estimation.views.retrieval import Vlad
from rhs.estimation.views.settings import PlaceSettings, SightingSettings

from .advanced import ConfirmationRules, ParticleAdvanced
from .config import ParticleFilter
from .confirmation import fits, possible, same_place
from .continuity_watch import ContinuityWatch

PLANE = np.ix_([0, 1, 5], [0, 1, 5])
CELL_M, HEADINGS = 0.25, 24  # of the table "which stored view is nearest to this pose"


@dataclass(frozen=True, eq=False)
class NamedPlaces:
    """Verified places of one view. claims: (mean (3,), covariance (3, 3), share) each. areas: how many places could have
    been named; p_true: chance that a named place is right, and likelihood of the claims for a robot that stands where they
    say, but was not expected there. Likelihoods are relative to that of a random naming. strong: the best of them explains
    so much of the view that it can confirm."""

    claims: tuple[tuple[np.ndarray, np.ndarray, float], ...]
    areas: float
    p_true: float
    strong: bool = True
    rules: ConfirmationRules = ConfirmationRules()

    @property
    def miss(self) -> float:
        """Likelihood of these claims for a robot that stands somewhere else."""
        return 1.0 - self.p_true

    def log_likelihood(self, states: np.ndarray) -> np.ndarray:
        """(N,) of these claims at states (N, 3)."""
        out = np.full(len(states), self.miss)
        for mean, covariance, share in self.claims:
            gap = states - mean
            c, s = np.cos(mean[2]), np.sin(mean[2])
            local = np.stack([c * gap[:, 0] + s * gap[:, 1], -s * gap[:, 0] + c * gap[:, 1], wrap(gap[:, 2])], axis=1)
            squared = np.einsum("ni,ij,nj->n", local, np.linalg.inv(covariance), local)
            out += self.p_true * share * self.areas * np.exp(-0.5 * squared)
        return np.log(out)

    def confirms(self, mean: np.ndarray) -> bool:
        """Whether a claim is the place of a planar pose (3,)."""
        return any(same_place(claim, mean, self.rules) for claim, _, _ in self.claims)

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """(count, 3) states round the claims, as many round each as its share."""
        shares = np.array([share for _, _, share in self.claims])
        counts = np.maximum(np.rint(count * shares / shares.sum()).astype(int), 1)
        return np.concatenate(
            [around(mean, cov, n, rng) for (mean, cov, _), n in zip(self.claims, counts, strict=True)]
        )


class PlaceEvidence:
    """Evidence from stored views. watching: whether each view goes on from the last."""

    watching: ContinuityWatch

    def __init__(self, settings: ParticleFilter, context: Context) -> None:
        self._settings, self._context = settings, context
        self._vlad: Vlad | None = None
        self._since_check = settings.check_every
        self._likenesses: tuple[Observation, np.ndarray] | None = None

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Store the views and tabulate which of them is nearest to any pose."""
        a = self._settings.advanced
        self._walls = ScanMatcher(grid, a.match)
        self.watching = ContinuityWatch(self._context.features, self._walls, a.continuity, smooth_share=a.smooth_share)
        sighting = SightingSettings(self._settings.min_inliers, ratio=self._context.features.ratio, ransac=a.ransac)
        memory = memory_of(views)
        settings = PlaceSettings("vlad", self._settings.checks, sighting, a.places)
        self._database = PlaceDatabase(memory, settings, self._context.rng)
        self._vlad = self._database.retrieval if isinstance(self._database.retrieval, Vlad) else None
        self._areas = max(2.0, 0.5 * len(memory))
        self._table = NearestView(memory, a)

    def log_likelihood(self, states: np.ndarray, observation: Observation) -> np.ndarray:
        """(N,) how much more the view looks like the stored view nearest each state than like an average one."""
        if self._vlad is None or self._settings.likeness_trust == 0:
            return np.zeros(len(states))
        likeness = self._likeness(observation)
        floor = float(np.median(likeness))
        nearest = self._table.lookup(states)
        value = np.where(nearest >= 0, likeness[nearest], floor)
        return self._settings.likeness_trust * np.maximum(value - floor, 0.0)

    def due(self, *, sure: bool) -> bool:
        """Whether this view is to be checked by geometry."""
        self._since_check += 1
        if sure and self._since_check < self._settings.check_every:
            return False
        self._since_check = 0
        return True

    def doubt(self, contradicted: bool) -> None:
        """After a contradiction the next view is checked as well."""
        if contradicted:
            self._since_check = self._settings.check_every

    def expects(self, observation: Observation, mean: np.ndarray) -> bool:
        """Whether this view, taken from a planar pose (3,), ought to be recognised."""
        return expected(self._database.memory, features(observation, self._context.features), se2(*mean),
                        self._settings.advanced.places.explain)

    def named(self, observation: Observation, believed: Sequence[np.ndarray]) -> NamedPlaces:
        """Ask the database where this was seen; the poses believed in (4x4) are checked as well."""
        answer = self._database.ask(features(observation, self._context.features), observation.camera, believed)
        a = self._settings.advanced
        places, least = possible(answer, self._walls, a.confirmation), (a.claim_sigma_m, a.claim_sigma_m, a.claim_sigma_rad)
        claims = tuple(
            (planar(r.map_from_body), r.covariance[PLANE] + np.diag(np.array(least) ** 2), float(share))
            for r, share in zip(places, shares(places, a.places), strict=True)
        )
        strong = bool(places) and places[0].score >= a.confirmation.strong
        return NamedPlaces(claims, self._areas, self._settings.p_true if strong else a.weak, strong, a.confirmation)

    def fits(self, scan: Scan | None, pose: np.ndarray) -> bool:
        """Whether the scan could have been taken from a planar pose (3,)."""
        return fits(scan, self._walls, pose, self._settings.advanced.confirmation)

    def _likeness(self, observation: Observation) -> np.ndarray:
        if self._likenesses is None or self._likenesses[0] is not observation:
            assert self._vlad is not None
            seen = features(observation, self._context.features)
            self._likenesses = (observation, self._vlad.likeness(seen.descriptors))
        return self._likenesses[1]


class NearestView:
    """Table over cells and headings: which stored view is nearest, -1 where none is near."""

    def __init__(self, memory: Memory, s: ParticleAdvanced) -> None:
        near_rad = np.radians(s.near_deg)
        stands = memory.stands
        self._table: np.ndarray = np.full((1, 1, HEADINGS), -1)
        if len(stands) == 0:
            self._corner = np.zeros(2)
            return
        self._corner = stands[:, :2].min(axis=0) - 2.0 * s.near_m
        size = np.ceil((stands[:, :2].max(axis=0) + 2.0 * s.near_m - self._corner) / CELL_M).astype(int)
        x = self._corner[0] + (np.arange(size[0]) + 0.5) * CELL_M
        y = self._corner[1] + (np.arange(size[1]) + 0.5) * CELL_M
        heading = (np.arange(HEADINGS) + 0.5) * 2.0 * np.pi / HEADINGS - np.pi
        best = np.full((size[0], size[1], HEADINGS), np.inf)
        self._table = np.full(best.shape, -1)
        for place, (px, py, yaw) in enumerate(stands):
            near_x, near_y = np.abs(x - px) <= s.near_m, np.abs(y - py) <= s.near_m
            turned = np.abs(wrap(heading - yaw))
            box = np.ix_(near_x, near_y, turned <= near_rad)
            gap = np.hypot((x[near_x] - px)[:, None], (y[near_y] - py)[None, :])[:, :, None]
            cost = gap + s.metres_per_radian * turned[turned <= near_rad]
            cost = np.where(gap <= s.near_m, cost, np.inf)
            closer = cost < best[box]
            best[box] = np.where(closer, cost, best[box])
            self._table[box] = np.where(closer, place, self._table[box])

    def lookup(self, states: np.ndarray) -> np.ndarray:
        """(N,) index of the stored view nearest each of states (N, 3), or -1."""
        return _looked_up(np.ascontiguousarray(states), self._corner, self._table)


@compiled
def _looked_up(states, corner, table):
    out = np.full(len(states), -1)
    columns, rows, headings = table.shape
    for k in range(len(states)):
        x, y = (states[k, 0] - corner[0]) / CELL_M, (states[k, 1] - corner[1]) / CELL_M
        if 0 <= x < columns and 0 <= y < rows:
            turn = int(np.floor((states[k, 2] + np.pi) / (2.0 * np.pi) * headings)) % headings
            out[k] = table[int(x), int(y), turn]
    return out
