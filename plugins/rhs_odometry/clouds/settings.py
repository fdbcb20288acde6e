"""Settings that all odometries on depth clouds share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.errors import ConfigError, check_choice, check_ranges

from ..advanced import GuessNoise


@dataclass
class CloudAdvanced:
    """Thresholds of the odometries that align clouds."""

    lean: float = 0.5
    """a normal counts for a direction when it leans into it by at least this (cosine; 0.5 is 30 degrees off its plane)"""
    slide_m: float = 0.15
    """how far the view is slid to see what leaves its surface, metres; about one step of a robot"""
    sure_sigmas: float = 5.0
    """deviations that noise does not explain"""
    correlated: float = 20.0
    """neighbouring readings of a depth camera err together: so many count as one"""
    least_m: float = 1e-3
    """no alignment is better than this, metres (1 sigma)"""
    least_rad: float = 5e-4
    """nor its angles, radians (1 sigma)"""
    slipped_m: float = 0.5
    """deviation along a direction that nothing holds, metres (1 sigma)"""
    leap_m: float = 1.0
    """an alignment further than this from its guess has locked on to something else, metres"""
    leap_rad: float = 0.6
    """or turned further from it, radians"""
    misfit: float = 0.25
    """an alignment is doubted when another motion lays the surfaces of two views on each other better by so much (mean
    squared distance in sigmas) ..."""
    gate_probability: float = 0.999
    """... and its covariance does not explain the difference (chance that it does where the alignment is right)"""
    guess: GuessNoise = field(default_factory=GuessNoise)

    def __post_init__(self) -> None:
        check_ranges("", self, lean=(0.0, 1.0), slide_m=(1e-4, 10.0), sure_sigmas=(0.1, 1000.0), correlated=(1.0, 1e6),
                     least_m=(1e-9, 1.0), least_rad=(1e-9, 1.0), slipped_m=(1e-6, 100.0), leap_m=(1e-3, 1000.0),
                     leap_rad=(1e-3, 3.2), misfit=(0.0, 1000.0), gate_probability=(0.5, 1.0 - 1e-12))


@dataclass
class CloudSettings:
    """How a depth image becomes a cloud, what motion is expected, and when the shape says too little."""

    needs: ClassVar[frozenset[str]] = frozenset({"depth"})
    provides: ClassVar[frozenset[str]] = frozenset()
    name: ClassVar[str] = "cloud"

    guess: str = "motion"
    """Where an alignment starts: motion (wheels, else the command, else the last motion) or last (the last motion)."""
    stride_px: int = 4
    """One point per square of this side, pixels."""
    min_range_m: float = 0.3
    """Depths nearer than this are not used, metres."""
    max_range_m: float = 8.0
    """Depths beyond this are not used, metres."""
    min_points: int = 100
    """Fewer points than this are no cloud: lost."""
    min_support: float = 0.025
    """Degenerate when a smaller share of the points holds the weakest direction. A bare corner is seen by up to
    0.024, small relief by 0.048 or more (simulated squares, seeds 100 to 102)."""
    slipping: str = "report"
    """Along a direction that is not held: report what the alignment says, or take the guess (wheels, command) there."""
    planar: bool = True
    """The camera stands on a robot: keep the motion on the floor; no effect when it is hand-held."""
    advanced: CloudAdvanced = field(default_factory=CloudAdvanced)

    def __post_init__(self) -> None:
        owner = f"odometry.{self.name}"
        check_choice(owner, "guess", self.guess, ("motion", "last"))
        check_choice(owner, "slipping", self.slipping, ("report", "guess"))
        check_ranges(owner, self, stride_px=(1, 64), min_range_m=(0.0, 100.0), max_range_m=(0.1, 1000.0),
                     min_points=(10, 1_000_000), min_support=(0.0, 1.0))
        if self.min_range_m >= self.max_range_m:
            raise ConfigError(f"{owner}.min_range_m={self.min_range_m} is not below max_range_m={self.max_range_m}")
