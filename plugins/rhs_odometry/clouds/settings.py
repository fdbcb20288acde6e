"""Settings that all odometries on depth clouds share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.errors import ConfigError, check_choice, check_range


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

    def __post_init__(self) -> None:
        owner = f"odometry.{self.name}"
        check_choice(owner, "guess", self.guess, ("motion", "last"))
        check_choice(owner, "slipping", self.slipping, ("report", "guess"))
        check_range(owner, "stride_px", self.stride_px, low=1, high=64, unit="pixels")
        check_range(owner, "min_range_m", self.min_range_m, low=0.0, high=100.0, unit="m")
        check_range(owner, "max_range_m", self.max_range_m, low=0.1, high=1000.0, unit="m")
        if self.min_range_m >= self.max_range_m:
            raise ConfigError(f"{owner}.min_range_m={self.min_range_m} is not below max_range_m={self.max_range_m}")
        check_range(owner, "min_points", self.min_points, low=10, high=1_000_000)
        check_range(owner, "min_support", self.min_support, low=0.0, high=1.0)
