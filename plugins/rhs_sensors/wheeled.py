"""Settings that every sensor on a robot with wheel encoders has."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import Bounded, within


@dataclass
class Wheeled(Bounded):
    """A sensor on a robot that counts how far its wheels turn."""

    noise: bool = True
    """false: an ideal sensor; recordings keep the noise they have, whatever is said here"""
    wheel_scale_sigma: float = within(0.02, 0.0, 0.5)
    """each run's encoders count distance and turn too long by such a share (1 sigma)"""
    wheel_distance_share: float = within(0.02, 0.0, 1.0)
    """noise of one reading of distance, share of it since the last view (1 sigma)"""
    wheel_turn_share: float = within(0.03, 0.0, 1.0)
    """noise of one reading of turn, share of it since the last view (1 sigma)"""
    wheel_slip_chance: float = within(0.0, 0.0, 1.0)
    """chance per view that the wheels spin: they count wheel_slip_share too much"""
    wheel_slip_share: float = within(0.5, 0.0, 1.0)
    """share counted too much when the wheels spin"""
