"""Settings of the localisers `sift_db`, `particle_filter` and `particle_filter_scan`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Localiser, PartSettings
from rhs.api.errors import ConfigError, check_range, one_of, within

from .advanced import ParticleAdvanced, ScanAdvanced, SiftDbAdvanced


@dataclass
class SiftDb(PartSettings):
    """Odometry corrected by recognised places: a few Kalman filters, weighed against each other (thesis 5.2)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    every: int = within(3, 1, 10000)
    """The places are asked every so many views, and at each view while lost."""
    retrieval: str = one_of("vlad", "votes", "kd_tree")
    """How candidates are found: votes (the thesis), kd_tree or vlad (fastest)."""
    checks: int = within(5, 1, 1000)
    """So many candidates are checked by geometry: about 7 ms each at 320x240."""
    min_inliers: int = within(15, 6, 10000)
    """Key-points that must agree on one motion between the views."""
    p_true: float = within(0.95, 0.5, 0.9999)
    """Chance that a verified answer is right; with 8 unique paintings of 71 about 97 % are."""
    kidnap_rate: float = within(0.0001, 1e-9, 0.5)
    """Chance per view that somebody carries the robot elsewhere."""
    match_every: int = within(3, 0, 10000)
    """The scan is laid onto the map every so many views, so that the walls hold the robot where no place is
    recognised (a corridor driven the other way round); 0: never."""
    drift_m_per_m: float = within(0.02, 0.0, 1.0)
    """Drift assumed beside the odometry's own covariance, metres per metre (visual odometry: 0.002 to 0.02)."""
    drift_rad_per_m: float = within(0.003, 0.0, 1.0)
    """Turn assumed to drift beside the odometry's own covariance, radians per metre."""
    tracking_above: float = within(0.9, 0.5, 0.9999)
    """Above this chance of being right the robot calls itself tracking."""
    lost_below: float = 0.5
    """Below this chance of being right the robot calls itself lost."""
    advanced: SiftDbAdvanced = field(default_factory=SiftDbAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("", "lost_below", self.lost_below, low=0.0, high=self.tracking_above)

    def build(self, context: Context) -> Localiser:
        from .sift_db import PlaceLocaliser

        return PlaceLocaliser(self, context)


@dataclass
class Particles(PartSettings):
    """What both filters have."""

    particles_min: int = within(500, 10, 1_000_000)
    """Fewest particles, when the belief is sharp."""
    particles_max: int = within(4000, 10, 1_000_000)
    """Most particles, when the robot may be anywhere."""
    scouts: int = within(100, 0, 1_000_000)
    """Particles thrown over the whole map at each view, to notice that the robot has been carried away."""
    scan_trust: float = within(0.25, 0.0, 1.0)
    """Exponent on the likelihood of a scan (0: scans are ignored); beams share their errors, so 1 is far too sure."""
    surprise: float = within(1.0, 0.0, 1000.0)
    """Most that beams ending in the open, before any wall of the map, count against a robot that has long known its
    place (a logarithm, per view): something new may stand there. Recognised places show when it was carried away."""
    kidnap_rate: float = within(0.0001, 1e-9, 0.5)
    """Chance per view that somebody carries the robot elsewhere."""
    motion_share: float = within(0.05, 0.0, 1.0)
    """Odometry noise assumed besides its own covariance, share of the motion."""
    tracking_above: float = within(0.9, 0.5, 0.9999)
    """Above this share of the weight in one cluster the robot calls itself tracking."""
    lost_below: float = 0.5
    """Below this share of the weight in the heaviest cluster the robot calls itself lost."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("", "lost_below", self.lost_below, low=0.0, high=self.tracking_above)
        if self.particles_min > self.particles_max:
            raise ConfigError(f"particles_min={self.particles_min} is above particles_max={self.particles_max}")


@dataclass
class ParticleFilter(Particles):
    """Monte Carlo localisation by what the view looks like and, where there is depth, by the scan (thesis 5.2)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    likeness_trust: float = within(6.0, 0.0, 100.0)
    """How much a view's likeness to the stored view nearest a particle counts (0: not at all)."""
    check_every: int = within(3, 1, 10000)
    """Views between two geometric checks while the robot knows its place; while it does not, every view is checked."""
    checks: int = within(5, 1, 1000)
    """Candidates checked by geometry."""
    min_inliers: int = within(15, 6, 10000)
    """Key-points that must agree on one motion between the views."""
    p_true: float = within(0.9, 0.5, 0.9999)
    """Chance that a verified place answer is right."""
    advanced: ParticleAdvanced = field(default_factory=ParticleAdvanced)

    def build(self, context: Context) -> Localiser:
        from .particle_filter import ParticleLocaliser
        from .particle_places import PlaceEvidence

        return ParticleLocaliser(self, context, PlaceEvidence(self, context))


@dataclass
class ParticleFilterScan(Particles):
    """Monte Carlo localisation by scans alone: for laser logs and for cameras that see no texture."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})

    particles_max: int = 10000
    """Most particles, when the robot may be anywhere; a scan says less than a view, so more than with places."""
    surprise: float = 100.0
    """Most that beams ending in the open, before any wall of the map, count against a robot that has long known its
    place (a logarithm, per view): something new may stand there. 100: it counts in full, since nothing but scans
    can tell this filter."""
    advanced: ScanAdvanced = field(default_factory=ScanAdvanced)

    def build(self, context: Context) -> Localiser:
        from .particle_filter import ParticleLocaliser

        return ParticleLocaliser(self, context, None)
