"""Settings of the sensor `mono`: one camera without depth on a robot with wheel encoders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import check_range

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Sensor


@dataclass
class Mono:
    """One camera without depth: depth and scan are taken away, the image is noisy."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "gray", "wheel", "command"})

    noise: bool = True
    """false: an ideal sensor; views of recordings keep the noise they have, whatever is said here"""
    image_sigma: float = 2.0
    """noise of each colour channel, grey levels of 255 (1 sigma)"""
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

    def __post_init__(self) -> None:
        owner = "sensor.mono"
        check_range(owner, "image_sigma", self.image_sigma, low=0.0, high=255.0)
        check_range(owner, "wheel_scale_sigma", self.wheel_scale_sigma, low=0.0, high=0.5)
        for name in ("wheel_distance_share", "wheel_turn_share", "wheel_slip_chance", "wheel_slip_share"):
            check_range(owner, name, getattr(self, name), low=0.0, high=1.0)

    def build(self, context: Context) -> Sensor:
        from .mono_sensor import MonoSensor

        return MonoSensor(self, context)
