"""The sensor `mono`: one camera without depth on a robot with wheel encoders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Context, Sensor
from rhs.api.errors import within
from rhs.api.records import Capture, Observation

from .degrade import Encoders, Wheeled, image_of, noisy_image


@dataclass
class Mono(Wheeled):
    """One camera without depth: depth and scan are taken away, the image is noisy."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "gray", "wheel", "command"})

    image_sigma: float = within(2.0, 0.0, 255.0)
    """noise of each colour channel, grey levels of 255 (1 sigma)"""

    def build(self, context: Context) -> Sensor:
        return MonoSensor(self, context)


class MonoSensor:
    """Takes depth and scan away; each noise has its own random stream, so that settings stay apart."""

    senses_ahead = True

    def __init__(self, settings: Mono, context: Context) -> None:
        self._settings = settings
        self._camera = context.camera
        self._image_rng, wheel_rng = context.rng.spawn(2)
        self._encoders = Encoders(settings, wheel_rng)

    def sense(self, capture: Capture) -> Observation:
        sigma = self._settings.image_sigma if self._settings.noise and not capture.sensed else 0.0
        return Observation(
            capture.index,
            capture.stamp_s,
            self._camera,
            image=noisy_image(image_of(capture, self._camera), sigma, self._image_rng),
            command=capture.command,
            wheel=self._encoders.read(capture.travel, exact=capture.sensed),
        )
