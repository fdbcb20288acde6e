"""Settings that every sensor on a robot with wheel encoders has."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import check_ranges


@dataclass
class Wheeled:
    """A sensor on a robot that counts how far its wheels turn."""

    noise: bool = True
    """false: an ideal sensor; recordings keep the noise they have, whatever is said here"""
    wheel_scale_sigma: float = 0.02
    """each run's encoders count distance and turn too long by such a share (1 sigma)"""
    wheel_distance_share: float = 0.02
    """noise of one reading of distance, share of it since the last view (1 sigma)"""
    wheel_turn_share: float = 0.03
    """noise of one reading of turn, share of it since the last view (1 sigma)"""
    wheel_slip_chance: float = 0.0
    """chance per view that the wheels spin: they count wheel_slip_share too much"""
    wheel_slip_share: float = 0.5
    """share counted too much when the wheels spin"""

    def check_wheels(self, owner: str) -> None:
        """Raises ConfigError where one is out of range. owner: such as `sensor.rgbd`."""
        check_ranges(owner, self, wheel_scale_sigma=(0.0, 0.5), wheel_distance_share=(0.0, 1.0), wheel_turn_share=(0.0, 1.0),
                     wheel_slip_chance=(0.0, 1.0), wheel_slip_share=(0.0, 1.0))
