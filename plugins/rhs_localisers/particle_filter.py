"""Monte Carlo localisation over places and scans (thesis section 5.2, which proposes it and measures nothing).

Per view: move the particles by the odometry; weigh them by the scan against the map (likelihood field) and by how much
the view looks like the stored view nearest to each; now and then let the place database name places, which weighs
particles and puts new ones there; resample when the weights have become uneven. Beside the cloud stands `elsewhere`, the
chance that the robot is where no particle is: scouts spread over the whole map keep it honest, and places named away
from the cloud turn it into particles.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from rhs.api.belief import RIGHT_M, RIGHT_RAD, chance_right
from rhs.api.contracts import Context
from rhs.api.geometry import planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, Scan, View
from rhs.estimation.filters.clusters import believed, cluster_labels, resampled_by_clusters, reweighted_by_clusters
from rhs.estimation.filters.particles import (
    ParticleSet,
    Peak,
    SizeLaw,
    around,
    displaced,
    effective_size,
    even,
    merged,
    peak,
    reweighted,
)
from rhs.estimation.scans.likelihood_field import LikelihoodField
from rhs.estimation.views.motion_consistency import Continuity, scan_continuity

from .advanced import ParticleAdvanced, ScanAdvanced
from .config import ParticleFilter, ParticleFilterScan
from .confirmation import Confirmation, Contradiction
from .map_spread import MapSpread
from .particle_places import NamedPlaces, PlaceEvidence
from .scan_fit import FitWatch
from .scan_search import rivals, summits, throws

PLANE = np.ix_([0, 1, 5], [0, 1, 5])


class ParticleLocaliser:
    """See rhs.api.contracts.Localiser. places: evidence from stored views, or None for scans alone."""

    def __init__(
        self, settings: ParticleFilter | ParticleFilterScan, context: Context, places: PlaceEvidence | None
    ) -> None:
        self._settings, self._places, self._rng = settings, places, context.rng
        a = self._advanced = settings.advanced
        self._law = SizeLaw(settings.particles_min, settings.particles_max, a.kld_epsilon, a.kld_quantile, a.kld_cell_m,
                            float(np.radians(a.kld_cell_deg)))
        self._base_sigma = np.array([a.base_sigma_m, a.base_sigma_m, a.base_sigma_rad])
        self._by_places = a if isinstance(a, ParticleAdvanced) else ParticleAdvanced()
        self._rules = self._by_places.confirmation
        self._field: LikelihoodField | None = None
        self._cloud: ParticleSet | None = None
        self._elsewhere = 1.0
        self._peak: Peak | None = None
        self._expected: np.ndarray | None = None  # where the last belief and the motion since put the robot
        self._scan: Scan | None = None  # the last one
        self._contradiction = Contradiction(self._rules)
        self._sure_views = 0
        self._confirmation = Confirmation(places is None, self._rules)
        self._fit: FitWatch | None = None  # of scans alone
        self._fresh = 1.0  # how much of this view is new ...
        self._unsearched = 0.0  # ... and of the views since the map was searched
        self._spread = MapSpread()

    def learn(self, views: Sequence[View], grid: OccupancyGrid) -> None:
        """Take the map for the scans and the stored views for the places."""
        s = self._settings
        self._field = LikelihoodField(grid, s.advanced.likelihood, trust=s.scan_trust, surprise=s.surprise)
        self._spread = MapSpread(views)
        if self._places is not None:
            self._places.learn(views, grid)
        if isinstance(s.advanced, ScanAdvanced):
            self._fit = FitWatch(grid, s.advanced.fit)

    def start(self, belief: Belief | None) -> None:
        """Begin round a belief, or spread over the whole map."""
        assert self._field is not None, "learn() comes before start()"
        if belief is None:
            states = self._field.anywhere(self._settings.particles_max, self._rng)
            self._elsewhere = 0.5
        else:
            spread = belief.covariance[PLANE] + np.diag(self._base_sigma**2)
            states = around(planar(belief.map_from_body), spread, 2 * self._settings.particles_min, self._rng)
            self._elsewhere = float(np.clip(1.0 - belief.probability, 1e-4, 0.99))
        self._cloud = even(states)
        self._peak, self._scan, self._fresh = None, None, 1.0
        if self._fit is not None:
            self._fit.start(None if belief is None else belief.probability)
        if self._places is not None:
            self._places.watching.begin()
        self._contradiction = Contradiction(self._rules)
        given = belief is not None and belief.probability > 0.9
        self._sure_views = self._advanced.long_sure if given else 0
        self._confirmation = Confirmation(given or self._places is None, self._rules)

    def update(self, observation: Observation, motion: Motion) -> Belief:
        """Move, weigh, use the named places, resample, and say what is believed."""
        assert self._cloud is not None and self._field is not None, "start() comes before update()"
        self._move(motion)
        if self._peak is not None and isinstance(self._advanced, ScanAdvanced):
            self._fresh = freshness(motion, self._advanced)
        self._watch(observation, motion)
        self._weigh(observation, motion)
        self._use_places(observation, motion)
        if effective_size(self._cloud) < 0.5 * len(self._cloud):
            self._cloud = resampled_by_clusters(self._cloud, self._law, self._rng, self._advanced.clusters)
        self._peak = peak(self._cloud, near_m=RIGHT_M, near_rad=RIGHT_RAD, cluster_m=self._advanced.cluster_m,
                          cluster_rad=self._advanced.cluster_rad)
        if self._fit is not None:
            self._explain(self._fit, scan_of(observation, motion), motion)
        if self._places is not None:
            if self._expected is not None:
                self._confirmation.follow(self._expected, self._peak.mean)
            if self._peak.mass * (1.0 - self._elsewhere) < self._by_places.shaken:
                self._confirmation.divided()
        self._sure_views = self._sure_views + 1 if self._status() is BeliefStatus.TRACKING else 0
        return self._belief(self._peak)

    def _explain(self, fit: FitWatch, scan: Scan | None, motion: Motion) -> None:
        """What does the map explain of the scan, from the belief and from elsewhere?"""
        assert self._peak is not None and self._field is not None and isinstance(self._advanced, ScanAdvanced)
        a, believed = self._advanced, self._peak.mean
        way_m = way_of(motion, a)
        fit.follow(self._expected, believed, way_m)
        if scan is not None and fit.rivals_due(way_m):
            score = partial(self._field.log_likelihood, scan=scan)
            thrown = self._field.anywhere(throws(self._field.area_m2, a.search), self._rng)
            found = summits(thrown, score(thrown), score, self._rng, a.search).states
            fit.compare(scan, rivals(found, score(found), believed, a.fit.apart_m, a.fit.rivals))
        fit.look(scan, believed, self._fresh)

    def _watch(self, observation: Observation, motion: Motion) -> None:
        """Does this view go on from the last one? If not, the robot may have been carried anywhere."""
        self._expected = None if self._peak is None else planar(se2(*self._peak.mean) @ motion.previous_from_body)
        if self._places is not None:
            seen = self._places.watching.goes_on(observation, motion, self._expected)
            self._contradiction.move(motion.previous_from_body)
            self._confirmation.travel(motion.previous_from_body, seen)
        else:
            last, self._scan = self._scan, scan_of(observation, motion)
            seen = scan_continuity(last, self._scan, motion.previous_from_body, self._advanced.continuity)
        if seen is Continuity.BROKEN:
            self._sure_views = 0
            self._elsewhere = max(self._elsewhere, self._advanced.continuity.carried)
            if self._fit is not None:
                self._fit.begin()

    def _move(self, motion: Motion) -> None:
        travel = planar(motion.previous_from_body)
        share = self._settings.motion_share
        length_m, turn_rad = float(np.hypot(travel[0], travel[1])), abs(float(travel[2]))
        sigma = self._base_sigma + share * np.array([length_m, length_m, turn_rad + 0.2 * length_m])
        covariance = motion.covariance[PLANE] + np.diag(sigma**2)
        assert self._cloud is not None
        self._cloud = ParticleSet(displaced(self._cloud.states, travel, covariance, self._rng), self._cloud.log_weights)
        self._elsewhere += self._settings.kidnap_rate * (1.0 - self._elsewhere)

    def _weigh(self, observation: Observation, motion: Motion) -> None:
        """Weigh the cloud and scouts spread over the map by the same evidence; what the scouts gain the cloud loses.

        The less the robot knows, the more scouts there are, and the more of them join the cloud: as they are where places
        are to be named, else the places that they climb to."""
        assert self._cloud is not None and self._field is not None
        a, search = self._advanced, None
        if isinstance(a, ScanAdvanced) and self._searching(a) and scan_of(observation, motion) is not None:
            search = a.search
        count = self._scouts() if search is None else throws(self._field.area_m2, search)
        scouts = even(self._field.anywhere(count, self._rng))
        evidence = self._evidence(np.concatenate([self._cloud.states, scouts.states]), observation, motion)
        here, there = evidence[: len(self._cloud)], evidence[len(self._cloud) :]
        labels = cluster_labels(self._cloud.states, a.clusters)
        self._cloud, gain = reweighted_by_clusters(self._cloud, here, labels, a.clusters)
        weighed, gain_elsewhere = reweighted(scouts, there)
        self._share_out(gain, gain_elsewhere)
        if self._elsewhere > 0.02:
            if search is not None:
                score = partial(self._evidence, observation=observation, motion=motion)
                weighed = summits(scouts.states, there, score, self._rng, search)
            joining = 0.5 * self._elsewhere
            self._cloud = merged(self._cloud, 1.0 - self._elsewhere, weighed, joining)
            self._elsewhere -= joining

    def _searching(self, a: ScanAdvanced) -> bool:
        """Whether the whole map is searched now: nothing is known, or the map does not explain what is believed."""
        if self._fit is not None and self._peak is not None and self._fit.chance < a.fit.doubt:
            self._unsearched += self._fresh
            if self._unsearched >= a.fit.again:
                self._unsearched = 0.0
                self._elsewhere = max(self._elsewhere, a.searching)
        return self._elsewhere >= a.searching

    def _scouts(self) -> int:
        few = max(self._settings.scouts, 1)
        return max(few, int(self._elsewhere * self._settings.particles_max)) if self._elsewhere > 0.05 else few

    def _share_out(self, gain: float, gain_elsewhere: float) -> None:
        """Bayes between the cloud and `elsewhere`, as cautiously as between clusters."""
        caution = self._advanced.clusters
        ahead = min(max(gain_elsewhere - gain, -50.0), 50.0)
        ahead = float(np.sign(ahead)) * max(abs(ahead) - caution.margin, 0.0) * caution.share
        odds = np.log(self._elsewhere) - np.log1p(-self._elsewhere) + ahead
        self._elsewhere = self._bounded(1.0 / (1.0 + np.exp(-odds)))

    def _bounded(self, chance: float) -> float:
        return float(min(max(chance, self._settings.kidnap_rate), 0.99))

    def _evidence(self, states: np.ndarray, observation: Observation, motion: Motion) -> np.ndarray:
        """(N,) log-likelihood of this view at each state."""
        assert self._field is not None
        scan = scan_of(observation, motion)
        out = np.zeros(len(states))
        if scan is not None and self._settings.scan_trust > 0:
            forgiving = self._sure_views >= self._advanced.long_sure
            out += self._fresh * self._field.log_likelihood(states, scan, forgiving=forgiving)
        if self._places is not None and not self._confirmation.held:  # a robot that knows its place is not moved by likeness
            out += self._places.log_likelihood(states, observation)
        return out

    def _use_places(self, observation: Observation, motion: Motion) -> None:
        """Weigh by verified places and put particles there, as far as `elsewhere` allows."""
        assert self._cloud is not None
        if self._places is None or not self._places.due(sure=self._status() is BeliefStatus.TRACKING):
            return
        named = self._places.named(observation, believed(self._cloud, self._advanced.clusters))
        if not named.claims:
            self._use_silence(observation)
            return
        if self._expected is not None and not self._accepts(named, self._expected, scan_of(observation, motion)):
            return
        self._cloud, gain = reweighted(self._cloud, named.log_likelihood(self._cloud.states))
        fresh = even(named.draw(max(self._settings.particles_min // 2, 1), self._rng))
        there = self._elsewhere * named.p_true
        here = (1.0 - self._elsewhere) * float(np.exp(min(gain, 50.0)))
        rest = self._elsewhere * named.miss
        total = there + here + rest
        self._elsewhere = self._bounded(rest / total)
        self._cloud = merged(self._cloud, max(here, 1e-12) / total, fresh, there / total)

    def _use_silence(self, observation: Observation) -> None:
        """No place was recognised; that speaks against the belief where one ought to be."""
        assert self._places is not None
        if self._expected is None or not self._places.expects(observation, self._expected):
            return
        self._places.doubt(True)
        if self._confirmation.silent():
            odds = self._by_places.places.explain.silence * self._elsewhere / (1.0 - self._elsewhere)
            self._elsewhere = self._bounded(odds / (1.0 + odds))

    def _accepts(self, named: NamedPlaces, expected: np.ndarray, scan: Scan | None) -> bool:
        """Whether the named places may move the belief; what they do to its standing is noted. A place confirms only if the
        scan could have been taken there, too."""
        assert self._places is not None
        contradicted = not named.confirms(expected)
        self._places.doubt(contradicted)
        poses = [mean for mean, _, _ in named.claims]
        against = contradicted and self._sure_views > 0
        if against and not named.strong:
            return False
        if not self._contradiction.convinces(poses, against=against, held=self._confirmation.held):
            return False
        if contradicted and named.strong:
            self._confirmation.place_named(agrees=False)
            self._confirmation.doubt()
        elif not contradicted and (self._confirmation.confirmed or (named.strong and self._places.fits(scan, expected))):
            self._confirmation.place_named(agrees=True)
        return True

    def _status(self) -> BeliefStatus:
        if self._peak is None:
            return BeliefStatus.LOST
        mass = self._peak.mass * (1.0 - self._elsewhere) * self._explained
        named_elsewhere = self._contradiction.pending >= 2 and not self._confirmation.held
        blurred = isinstance(self._advanced, ScanAdvanced) and self._peak.near < self._advanced.near_above
        if mass >= self._settings.tracking_above and self._confirmation.confirmed and not named_elsewhere and not blurred:
            return BeliefStatus.TRACKING
        return BeliefStatus.CONVERGING if mass >= self._settings.lost_below else BeliefStatus.LOST

    @property
    def _explained(self) -> float:
        """Chance that the belief is no chance likeness, by what the map explains of the scans."""
        return 1.0 if self._fit is None else self._fit.chance

    def _belief(self, cluster: Peak) -> Belief:
        pose = se2(*cluster.mean)
        covariance = np.diag([0.0, 0.0, 1e-6, 1e-6, 1e-6, 0.0])
        covariance[PLANE] = cluster.covariance
        assert self._cloud is not None
        details = {"particles": float(len(self._cloud)), "elsewhere": self._elsewhere, "cluster_mass": cluster.mass}
        standing = self._contradiction.chance(held=self._confirmation.held) * self._confirmation.chance
        if self._fit is not None:
            details |= {"fit_chance": self._fit.chance, "fit_share": self._fit.share}
        stated, status = covariance + self._spread.at(pose), self._status()
        left = chance_right(stated) / chance_right(covariance)  # of the chance, by a map that is unsure itself
        probability = cluster.near * (1.0 - self._elsewhere) * standing * self._explained * left
        if status is BeliefStatus.TRACKING and left < self._settings.tracking_above:
            status = BeliefStatus.DEGRADED
        return Belief(pose, stated, status, probability, details)


def freshness(motion: Motion, a: ScanAdvanced) -> float:
    """How much of a view after this motion is new (0..1): a robot that stands sees the same errors again."""
    return min(1.0, way_of(motion, a) / a.fresh_m) if a.fresh_m > 0 else 1.0


def way_of(motion: Motion, a: ScanAdvanced) -> float:
    """Metres of a motion, a turn counted by `fresh_lever_m`."""
    x_m, y_m, yaw_rad = planar(motion.previous_from_body)
    return float(np.hypot(x_m, y_m)) + a.fresh_lever_m * abs(float(yaw_rad))


def scan_of(observation: Observation, motion: Motion) -> Scan | None:
    """What the sensor measured, else what the odometry made of it."""
    return observation.scan if observation.scan is not None else motion.scan
