"""Settings of the sensor `mono`: one camera without depth on a robot with wheel encoders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import check_range

from .wheeled import Wheeled

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Sensor


@dataclass
class Mono(Wheeled):
    """One camera without depth: depth and scan are taken away, the image is noisy."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "gray", "wheel", "command"})

    image_sigma: float = 2.0
    """noise of each colour channel, grey levels of 255 (1 sigma)"""

    def __post_init__(self) -> None:
        owner = "sensor.mono"
        check_range(owner, "image_sigma", self.image_sigma, low=0.0, high=255.0)
        self.check_wheels(owner)

    def build(self, context: Context) -> Sensor:
        from .mono_sensor import MonoSensor

        return MonoSensor(self, context)
