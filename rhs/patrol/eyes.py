"""One view as it comes to the odometry: captured, checked, sensed, checked; and what only the judge knows of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.contracts import Sensor, Source
from rhs.api.frozen import freeze
from rhs.api.packed_pictures import hand_on_png
from rhs.api.records import Capture, Observation
from rhs.api.validate import check_capture, check_observation, check_pose
from rhs.api.validate_source import check_clearance
from rhs.estimation.views.features import foresee


class Stopwatch:
    """Collects the milliseconds of the wall's clock spent in named stages."""

    def __init__(self) -> None:
        self.timings_ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.timings_ms[stage] = self.timings_ms.get(stage, 0.0) + 1e3 * (time.perf_counter() - begin)


@dataclass(frozen=True)
class Judged:
    """What is true of a view: least clearance in metres since the one before, whether the robot touched something, and the
    pose (4x4) where somebody knows it."""

    clearance_m: float
    collided: bool
    truth: np.ndarray | None


@dataclass(frozen=True, eq=False)
class Looked:
    """A view. judged: asked once, when the view has been estimated. clock: of its stages so far."""

    capture: Capture
    observation: Observation
    judged: Callable[[], Judged]
    clock: Stopwatch


class Remembered:
    """Eyes that saw it all before. seen: the views of a survey; each is given once, and let go."""

    def __init__(self, seen: list[Looked]) -> None:
        self._seen = seen

    def __call__(self, move: Callable[[], Capture | None]) -> Looked | None:
        """The next view of the survey. move: how the loop would take it; not asked."""
        return self._seen.pop(0) if self._seen else None

    def close(self) -> None:
        """Nothing is under way."""


class Eyes:
    """Takes views in line, when the loop asks for them."""

    def __init__(self, source: Source, sensor: Sensor, who: Mapping[str, str], *, after_s: float = -np.inf) -> None:
        """who: kind -> the part as a person typed it, for errors. after_s: stamp of the last view before."""
        self.source, self.sensor, self._who, self._after_s = source, sensor, who, after_s

    def __call__(self, move: Callable[[], Capture | None]) -> Looked | None:
        """The view that `move` captures; None at the end."""
        clock = Stopwatch()
        with clock("capture"):
            capture = move()
        if capture is None:
            return None
        capture = check_capture(capture, who=self._who["source"], after_s=self._after_s)
        self._after_s = capture.stamp_s
        with clock("sense"):
            observation = with_extras(self.sensor.sense(capture), capture)
            observation = check_observation(observation, capture, who=self._who["sensor"])
            hand_on_png(capture.image, observation.image)
        foresee(observation)
        return Looked(capture, observation, self._judged, clock)

    def _judged(self) -> Judged:
        clearance_m, collided = check_clearance(self.source.clearance_m(), who=self._who["source"])
        truth = self.source.truth()
        if truth is not None:
            truth = check_pose(truth, who=self._who["source"], field="truth()")
        return Judged(clearance_m, collided, truth)

    def close(self) -> None:
        """Nothing is under way."""


def with_extras(observation: Observation, capture: Capture) -> Observation:
    """The observation with the bumper and the extra modalities of its capture, which pass every sensor."""
    if not isinstance(observation, Observation) or (not capture.extras and capture.contact is None):
        return observation
    return replace(observation, extras=freeze({**capture.extras, **observation.extras}), contact=capture.contact)
