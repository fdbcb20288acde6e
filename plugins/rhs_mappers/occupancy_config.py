"""Settings of the mapper `occupancy`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Context, Mapper, PartSettings
from rhs.api.errors import ConfigError, within


@dataclass
class Occupancy(PartSettings):
    """Bayes occupancy grid of the thesis (eqs 3.8-3.13) from scans."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})

    resolution_m: float = within(0.1, 0.01, 2.0)
    """Side of a cell, metres. The thesis uses 0.1."""
    true_hit: float = within(0.8, 0.01, 0.999)
    """TrueHit: chance that the sensor reports an obstacle that is there. The thesis gives no value."""
    false_alarm: float = within(0.1, 0.001, 0.99)
    """FalseAlarm: chance that it reports one that is not there."""
    range_max_m: float = within(7.0, 0.1, 200.0)
    """Beams are used up to here, metres; what lies further only says that the way there is free. Depth noise grows
    with the square of the distance and passes one cell (0.1 m) near 8 m."""
    free_max_m: float = within(0.0, 0.0, 200.0)
    """Beams say that their way is free up to here, metres; 0: as far as range_max_m. Walls further away are drawn, but not
    all the way to them is free: beams that graze a wall, or come back from behind glass, would wear it away."""
    belief_bound: float = within(0.99, 0.6, 0.999999)
    """Beliefs stay within [1 - bound, bound], so that a cell can change its mind after a hundred equal views."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.false_alarm >= self.true_hit:
            raise ConfigError(
                f"false_alarm={self.false_alarm} must be smaller than true_hit={self.true_hit}: "
                "a hit has to speak for an obstacle"
            )

    def build(self, context: Context) -> Mapper:
        from .occupancy import OccupancyMapper

        return OccupancyMapper(self, context.world.bounds_m, grows=not context.world.bounds_known)
