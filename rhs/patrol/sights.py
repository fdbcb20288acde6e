"""What the patrol keeps of the survey's pictures, and what it finds changed at each place (changes.json).

Of every stored view that has an image and depth a picture 160 wide is kept in memory, at most MOST of them; those that a
place is compared with are written to places_before/. Nothing here knows the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.geometry import planar
from rhs.api.records import FeatureSettings, Observation, Step, View
from rhs.api.spare import later
from rhs.estimation.views.change_settings import ChangeSettings
from rhs.estimation.views.features import features, write_image

MOST = 600  # pictures kept, 130 kB each; a survey with more keeps every second, every fourth, ...


class Sights:
    """Keeps pictures while the survey goes on; afterwards compares with them."""

    def __init__(self, every: int, feature_settings: FeatureSettings) -> None:
        self.every, self.features = every, feature_settings
        self.kept: dict[int, Any] = {}  # number of the view -> Sight, its pose as first believed
        self.references: list[Any] = []
        self._rows: list[Callable[[], dict[str, Any]]] = []  # of each place; some may still be worked out

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
        x_m, y_m, yaw_rad = planar(step.belief.map_from_body)
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(step.belief.covariance[:2, :2])[-1]))
        row: dict[str, Any] = {
            "picture": picture, "index": step.index, "x_m": round(float(x_m), 4), "y_m": round(float(y_m), 4),
            "yaw_rad": round(float(yaw_rad), 5), "sigma_m": round(sigma_m, 5),
            "sigma_yaw_rad": round(float(np.sqrt(step.belief.covariance[5, 5])), 6), "width_px": 0,
            "before": [], "changes": []}
        if self.references and _complete(step.observation):
            found = self._found(step, picture, folder, rng)
            self._rows.append(lambda: row | found())
        else:
            self._rows.append(lambda: row)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What was found at each place, in order."""
        return [row() for row in self._rows]

    def _found(self, step: Step, picture: str, folder: Path, rng: np.random.Generator) -> Callable[[], dict[str, Any]]:
        from rhs.estimation.views.view_pose import Snapshot

        now = _small(step.observation, step.belief.map_from_body)
        seen = Snapshot(features(step.observation, self.features), step.observation.camera)
        return later(lambda: self._changed(now, seen, picture, folder, rng))

    def _changed(self, now: Any, seen: Any, picture: str, folder: Path, rng: np.random.Generator) -> dict[str, Any]:
        from rhs.estimation.views.changes import compare
        from rhs.estimation.views.references import registered

        before = registered(now, seen, self.references, rng=rng, settings=ChangeSettings())
        names = [f"{picture}_{number}" for number in range(1, len(before) + 1)]
        for name, sight in zip(names, before, strict=True):
            folder.mkdir(exist_ok=True)
            write_image(folder / f"{name}.png", sight.image)
        return {"width_px": now.camera.width, "before": names,
                "changes": [_plain(change, now, before) for change in compare(now, before)]}


def _complete(observation: Observation) -> bool:
    return observation.image is not None and observation.depth is not None


def _small(observation: Observation, map_from_body: np.ndarray) -> Any:
    from rhs.estimation.views.references import small

    assert observation.image is not None and observation.depth is not None
    return small(observation.image, observation.depth, camera=observation.camera, map_from_body=map_from_body)


def _plain(change: Any, now: Any, before: Sequence[Any]) -> dict[str, Any]:
    """A change as JSON has it: outlines in pixels of the small pictures, of now and of each one before."""
    def outline(sight: Any) -> list[list[float]]:
        return [[round(float(v), 1) for v in point] for point in change.outline(sight)]

    return {"verdict": change.verdict, "width_m": round(change.width_m, 3), "height_m": round(change.height_m, 3),
            "at_m": [round(float(v), 3) for v in change.at_m], "outline_px": outline(now),
            "before_px": [outline(sight) for sight in before]}
