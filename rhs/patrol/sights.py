"""What the patrol keeps of the survey's pictures, and what it finds changed at each place and on the way (changes.json).

Of every stored view that has an image and depth a picture 160 wide is kept in memory, at most MOST of them; those that a
place is compared with are written to places_before/. On the way one look is not believed: told is what two of them say.
Nothing here knows the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rhs.api.geometry import inverse, planar
from rhs.api.randomness import generator
from rhs.api.records import BeliefStatus, FeatureSettings, Observation, Step, View
from rhs.api.spare import later
from rhs.base.errors import ConfigError
from rhs.estimation.views.change_settings import ChangeSettings
from rhs.estimation.views.features import features, write_image

if TYPE_CHECKING:
    from rhs.estimation.views.changes import Change, Sight

MOST = 600  # pictures kept, 130 kB each; a survey with more keeps every second, every fourth, ...
TURNED_RAD = np.radians(45.0)  # since the last look, another one is due: the camera shows something else
AGREE_M = 0.5  # two looks see one face of a thing, or two of its faces, at most so far apart
TOLD = ("new", "gone")  # on the way; what only looks different does so in other light all the way


class Look(NamedTuple):
    """A view that was compared. row: what of it JSON has; now: its picture; before: the survey's of the same; changes."""

    row: dict[str, Any]
    now: Sight
    before: Sequence[Sight]
    changes: Sequence[Change]


class Sights:
    """Keeps pictures while the survey goes on; afterwards compares with them. look_m: between looks on the way, 0: none."""

    def __init__(self, every: int, feature_settings: FeatureSettings, look_m: float = 0.0) -> None:
        self.every, self.features, self.look_m = every, feature_settings, look_m
        self.kept: dict[int, Any] = {}  # number of the view -> Sight, its pose as first believed
        self.references: list[Any] = []
        self._rows: list[Callable[[], dict[str, Any]]] = []  # of each place; some may still be worked out
        self._looks: list[Callable[[], Look]] = []  # the same on the way
        self._last: np.ndarray | None = None  # map_from_body (4, 4) of the last look

    def watch(self, steps: Iterable[Step]) -> Iterator[Step]:
        """The same steps; every so many pictures are kept."""
        for number, step in enumerate(steps):
            if number % self.every == 0 and _complete(step.observation):
                self.kept[number] = _small(step.observation, step.belief.map_from_body)
                if len(self.kept) > MOST:
                    self.every *= 2
                    self.kept = {k: sight for k, sight in self.kept.items() if k % self.every == 0}
            yield step

    def settle(self, views: Sequence[View]) -> None:
        """Where the finished survey puts the pictures, and their key-points."""
        from dataclasses import replace

        from rhs.estimation.views.references import Reference
        from rhs.estimation.views.view_pose import Snapshot

        for number, sight in self.kept.items():
            view = views[number]
            if view.features is not None:
                placed = replace(sight, map_from_body=view.map_from_body)
                self.references.append(Reference(placed, Snapshot(view.features, view.camera)))
        self.kept = {}

    def compare(self, step: Step, picture: str, folder: Path, *, rng: np.random.Generator) -> None:
        """Compare the view of a place reached, whose picture has this name, with the survey's; pictures go to the folder.
        Done when `rows` is asked for, at the latest."""
        row = _row(step, picture)
        if self.references and _complete(step.observation):
            self._last = step.belief.map_from_body
            self._rows.append(self._compared(step, row, rng, lambda look: _written(look, folder)))
        else:
            self._rows.append(lambda: row)

    def look(self, step: Step, *, seed: int) -> None:
        """Compare a view on the way, where the robot is sure of its pose and has gone or turned far enough since the last
        look. seed: the run's."""
        sure = step.belief.status is BeliefStatus.TRACKING
        if self.look_m and sure and self.references and _complete(step.observation) and self._due(step.belief.map_from_body):
            self._last = step.belief.map_from_body
            rng, row = generator(seed, f"look {step.index}"), _row(step, f"way_{step.index:04d}")
            self._looks.append(self._compared(step, row, rng, lambda look: look))

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What was found at each place, in order."""
        return [row() for row in self._rows]

    def on_way(self, folder: Path) -> list[dict[str, Any]]:
        """What two looks on the way say is new or gone, and no place told: a row for each look that shows most of such a
        thing. Its pictures, now and before, go to the folder."""
        looks = [look() for look in self._looks]
        at_places = [change for row in self.rows for change in row["changes"]]
        rows = []
        for number, changes in sorted(confirmed([look.changes for look in looks], at_places).items()):
            look = looks[number]._replace(changes=changes)
            folder.mkdir(exist_ok=True)
            write_image(folder / f"{look.row['picture']}.png", look.now.image)
            rows.append({**_written(look, folder), "on_way": True})
        return rows

    def _due(self, pose: np.ndarray) -> bool:
        if self._last is None:
            return True
        x_m, y_m, turn_rad = planar(inverse(self._last) @ pose)
        return float(np.hypot(x_m, y_m)) >= self.look_m or abs(float(turn_rad)) >= TURNED_RAD

    def _compared(self, step: Step, row: dict[str, Any], rng: np.random.Generator, then: Callable[[Look], Any],
                  ) -> Callable[[], Any]:
        """What gives `then` of the look, worked out beside what follows."""
        from rhs.estimation.views.changes import compare
        from rhs.estimation.views.references import registered
        from rhs.estimation.views.view_pose import Snapshot

        now = _small(step.observation, step.belief.map_from_body)
        seen = Snapshot(features(step.observation, self.features), step.observation.camera)

        def compared() -> Any:
            before = registered(now, seen, self.references, rng=rng, settings=ChangeSettings())
            return then(Look(row, now, before, compare(now, before)))

        return later(compared)


def confirmed(looks: Sequence[Sequence[Change]], at_places: Sequence[dict[str, Any]]) -> dict[int, list[Change]]:
    """By the number of the look that shows most of it: what two looks or more say is new, or gone, within AGREE_M of one
    another in the map, but for what the places say (`verdict`, `at_m`)."""
    marks = [(number, change) for number, changes in enumerate(looks) for change in changes if change.verdict in TOLD]
    marks.sort(key=lambda mark: -mark[1].pixels)
    done = [(one["verdict"], np.array(one["at_m"])) for one in at_places]
    told: dict[int, list[Change]] = {}
    for number, change in marks:
        agree = {other for other, mark in marks if _same(change, mark.verdict, mark.at_m)}
        if len(agree) > 1 and not any(_same(change, *one) for one in done):
            told.setdefault(number, []).append(change)
            done.append((change.verdict, change.at_m))
    return told


def _same(change: Change, verdict: str, at_m: np.ndarray) -> bool:
    return change.verdict == verdict and float(np.hypot(*(change.at_m - at_m)[:2])) <= AGREE_M


def check_looks(look_m: float, provides: Iterable[str]) -> None:
    """Raises ConfigError where mission.look_m would compare nothing: it needs a sensor with image and depth."""
    if not {"image", "depth"} <= set(provides):
        found = ", ".join(sorted(provides))
        raise ConfigError(f"mission.look_m={look_m:g} needs a sensor with image and depth; found {found}; type sensor=rgbd, "
                          "or mission.look_m=0")


def _complete(observation: Observation) -> bool:
    return observation.image is not None and observation.depth is not None


def _small(observation: Observation, map_from_body: np.ndarray) -> Any:
    from rhs.estimation.views.references import small

    assert observation.image is not None and observation.depth is not None
    return small(observation.image, observation.depth, camera=observation.camera, map_from_body=map_from_body)


def _row(step: Step, picture: str) -> dict[str, Any]:
    """Of a view that is not compared with anything yet."""
    x_m, y_m, yaw_rad = planar(step.belief.map_from_body)
    sigma_m = float(np.sqrt(np.linalg.eigvalsh(step.belief.covariance[:2, :2])[-1]))
    return {"picture": picture, "index": step.index, "x_m": round(float(x_m), 4), "y_m": round(float(y_m), 4),
            "yaw_rad": round(float(yaw_rad), 5), "sigma_m": round(sigma_m, 5),
            "sigma_yaw_rad": round(float(np.sqrt(step.belief.covariance[5, 5])), 6), "width_px": 0,
            "before": [], "changes": []}


def _written(look: Look, folder: Path) -> dict[str, Any]:
    """The row of a look, whose pictures of the survey are written."""
    names = [f"{look.row['picture']}_{number}" for number in range(1, len(look.before) + 1)]
    for name, sight in zip(names, look.before, strict=True):
        folder.mkdir(exist_ok=True)
        write_image(folder / f"{name}.png", sight.image)
    return {**look.row, "width_px": look.now.camera.width, "before": names,
            "changes": [_plain(change, look.now, look.before) for change in look.changes]}


def _plain(change: Change, now: Sight, before: Sequence[Sight]) -> dict[str, Any]:
    """A change as JSON has it: outlines in pixels of the small pictures, of now and of each one before."""
    def outline(sight: Any) -> list[list[float]]:
        return [[round(float(v), 1) for v in point] for point in change.outline(sight)]

    return {"verdict": change.verdict, "width_m": round(change.width_m, 3), "height_m": round(change.height_m, 3),
            "at_m": [round(float(v), 3) for v in change.at_m], "outline_px": outline(now),
            "before_px": [outline(sight) for sight in before]}
