"""The sensor `mono`: see its settings."""

from __future__ import annotations

from rhs.api.contracts import Context
from rhs.api.records import Capture, Observation

from .degrade import Encoders, image_of, noisy_image
from .mono import Mono


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
