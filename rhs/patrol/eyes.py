"""One view as it comes to the odometry: captured, checked, sensed, checked; and what only the judge knows of it. Taken when
the loop asks for it, or before that: the way of a survey that is led depends on no estimate, and each part draws from a
generator of its own, so that taken ahead or in line the views are the same to the last bit.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from queue import SimpleQueue
from typing import TypeVar

import numpy as np

from rhs.api.contracts import Sensor, Source
from rhs.api.frozen import freeze
from rhs.api.packed_pictures import hand_on_png
from rhs.api.records import Capture, Observation
from rhs.api.validate import check_capture, check_observation, check_pose
from rhs.api.validate_source import check_clearance
from rhs.base.system import processors
from rhs.estimation.views.features import foresee

MOST = 3  # views that wait, about 1 MB each
PATIENCE_S = 10.0  # for the view that is being taken when the run ends
_Value = TypeVar("_Value")


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


class Ahead:
    """Eyes that look ahead, in a thread of their own: while one view is estimated the next ones are rendered and sensed; the
    interpreter's lock is free in the renderer, in OpenCV and in numpy's generators. What taking a view raised comes out
    where the loop would have met it. `close` them: the thread is gone afterwards, unless a view takes longer than
    PATIENCE_S."""

    def __init__(self, eyes: Eyes) -> None:
        self._eyes = eyes
        self._taken: SimpleQueue[Callable[[], Looked | None]] = SimpleQueue()
        self._room = threading.Semaphore(MOST)
        self._over = False
        self._thread = threading.Thread(target=self._take, name="ahead", daemon=True)

    def __call__(self, move: Callable[[], Capture | None]) -> Looked | None:
        """The next view of the survey. move: how the loop would take it; not asked."""
        if self._thread.ident is None:
            self._thread.start()
        looked = self._taken.get()()
        self._room.release()
        return looked

    def close(self) -> None:
        """Take no more views. Safe to call twice."""
        self._over = True
        self._room.release()
        if self._thread.ident is not None and threading.current_thread() is not self._thread:
            self._thread.join(PATIENCE_S)

    def _take(self) -> None:
        while True:
            self._room.acquire()
            if self._over:
                return
            outcome, more = settled(lambda: self._eyes(self._eyes.source.lead))
            looked = outcome() if more else None
            if looked is not None:  # the source goes on: what is true of this view is asked now
                judged, more = settled(looked.judged)
                outcome = partial(replace, looked, judged=judged)
            self._taken.put(outcome)
            if looked is None or not more:
                return


def settled(call: Callable[[], _Value]) -> tuple[Callable[[], _Value], bool]:
    """The call made now: what gives its value, or raises what it raised, later; whether it went well."""
    try:
        value = call()
    except BaseException as error:  # a part may raise anything, even exit
        raised = error

        def again() -> _Value:
            raise raised

        return again, False
    return lambda: value, True


def wants_ahead(wanted: str) -> bool:
    """Whether something may be done beside the run. wanted: on, off, or auto, which wants two processors."""
    return wanted == "on" or (wanted == "auto" and processors() > 1)


def looks_ahead(wanted: str, source: Source, sensor: Sensor) -> bool:
    """Whether to look ahead: parts must allow it."""
    return bool(source.leads_ahead and sensor.senses_ahead) and wants_ahead(wanted)
