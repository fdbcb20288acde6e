"""Settings of the localisers `particle_filter` and `particle_filter_scan`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Localiser
from rhs.api.errors import ConfigError, check_ranges

from .advanced import ParticleAdvanced, ScanAdvanced


@dataclass
class Particles:
    """What both filters have."""

    provides: ClassVar[frozenset[str]] = frozenset()
    owner: ClassVar[str]  # what stands before a setting's name in messages

    particles_min: int = 500
    """Fewest particles, when the belief is sharp."""
    particles_max: int = 4000
    """Most particles, when the robot may be anywhere."""
    scouts: int = 100
    """Particles thrown over the whole map at each view, to notice that the robot has been carried away."""
    scan_trust: float = 0.25
    """Exponent on the likelihood of a scan (0: scans are ignored); beams share their errors, so 1 is far too sure."""
    surprise: float = 1.0
    """Most that beams ending in the open, before any wall of the map, count against a robot that has long known its
    place (a logarithm, per view): something new may stand there. Recognised places show when it was carried away."""
    kidnap_rate: float = 0.0001
    """Chance per view that somebody carries the robot elsewhere."""
    motion_share: float = 0.05
    """Odometry noise assumed besides its own covariance, share of the motion."""
    tracking_above: float = 0.9
    """Above this share of the weight in one cluster the robot calls itself tracking."""
    lost_below: float = 0.5
    """Below this share of the weight in the heaviest cluster the robot calls itself lost."""

    def __post_init__(self) -> None:
        check_ranges(self.owner, self, particles_min=(10, 1_000_000), particles_max=(10, 1_000_000), scouts=(0, 1_000_000),
                     scan_trust=(0.0, 1.0), surprise=(0.0, 1000.0), kidnap_rate=(1e-9, 0.5), motion_share=(0.0, 1.0),
                     tracking_above=(0.5, 0.9999), lost_below=(0.0, self.tracking_above))
        if self.particles_min > self.particles_max:
            raise ConfigError(f"{self.owner}.particles_min={self.particles_min} is above particles_max={self.particles_max}")


@dataclass
class ParticleFilter(Particles):
    """Monte Carlo localisation by what the view looks like and, where there is depth, by the scan (thesis 5.2)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    owner = "localiser.particle_filter"

    likeness_trust: float = 6.0
    """How much a view's likeness to the stored view nearest a particle counts (0: not at all)."""
    check_every: int = 3
    """Views between two geometric checks while the robot knows its place; while it does not, every view is checked."""
    checks: int = 5
    """Candidates checked by geometry."""
    min_inliers: int = 15
    """Key-points that must agree on one motion between the views."""
    p_true: float = 0.9
    """Chance that a verified place answer is right."""
    advanced: ParticleAdvanced = field(default_factory=ParticleAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self.owner, self, likeness_trust=(0.0, 100.0), check_every=(1, 10000), checks=(1, 1000),
                     min_inliers=(6, 10000), p_true=(0.5, 0.9999))

    def build(self, context: Context) -> Localiser:
        from .particle_filter import ParticleLocaliser
        from .particle_places import PlaceEvidence

        return ParticleLocaliser(self, context, PlaceEvidence(self, context))


@dataclass
class ParticleFilterScan(Particles):
    """Monte Carlo localisation by scans alone: for laser logs and for cameras that see no texture."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    owner = "localiser.particle_filter_scan"

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
