"""What sensors must do (see rhs.testing)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.geometry import se3
from rhs.api.records import Capture, Observation, Twist
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers
from rhs.api.validate import check_observation

from .room import CAMERA, HALL, RATE_HZ, SHORT, cloud_of, context, drive, paintings, ranges, scan_of, see
from .shared_state import same, untouched

NEAR_THE_LEFT_WALL = replace(HALL, start=(0.8, 1.5, 0.35))
DEPTH_SHARE, RANGE_SHARE, RANGE_M = 0.1, 0.1, 0.05
BASELINE_M = 0.12  # from the camera to a second one on its right
TINT = np.array([1.0, 0.85, 0.6])


@cache
def captures() -> tuple[tuple[np.ndarray, Capture], ...]:
    """True poses and ideal views near the left wall of the room, warm in colour, with what a second camera sees."""
    out = []
    aside = CAMERA.body_from_camera @ se3(np.eye(3), np.array([BASELINE_M, 0.0, 0.0]))
    right = replace(CAMERA, body_from_camera=aside)
    for index, ((pose, _), (ahead, left)) in enumerate(zip(drive(NEAR_THE_LEFT_WALL, SHORT), SHORT, strict=True)):
        capture = see(CAMERA, pose, paintings(), index, NEAR_THE_LEFT_WALL)
        assert capture.image is not None
        there = see(right, pose, paintings(), index, NEAR_THE_LEFT_WALL).image
        assert there is not None
        out.append((pose, freeze(replace(
            capture, image=np.rint(capture.image * TINT).astype(np.uint8), travel=np.array([ahead, 0.0, left]),
            command=Twist(ahead * RATE_HZ, left * RATE_HZ, 1.0 / RATE_HZ), scan=scan_of(pose, NEAR_THE_LEFT_WALL),
            extras={"cloud": cloud_of(pose, NEAR_THE_LEFT_WALL), RIGHT_CAMERA: camera_numbers(right),
                    RIGHT_IMAGE: np.rint(there * TINT).astype(np.uint8)}))))
    return tuple(out)


def hard() -> list[Capture]:
    """These views, then one without content, then one without known depth and ranges."""
    views = [capture for _, capture in captures()]
    last = views[-1]
    assert last.image is not None and last.depth is not None and last.scan is not None
    n = len(views)
    blank = replace(last, index=n, stamp_s=n / RATE_HZ, image=np.full_like(last.image, 90))
    dark = replace(last, index=n + 1, stamp_s=(n + 1) / RATE_HZ, depth=np.full_like(last.depth, np.nan),
                   scan=replace(last.scan, ranges_m=np.full_like(last.scan.ranges_m, np.nan)),
                   extras={**last.extras, "cloud": np.empty((0, 3), np.float32)})
    return [*views, freeze(blank), freeze(dark)]


def _observations(settings: Any, folder: Path, views: list[Capture], seed: int = 0) -> list[Observation]:
    sensor = complete("sensor", settings.build(context(folder, seed, NEAR_THE_LEFT_WALL)))
    with untouched(views):
        return [check_observation(sensor.sense(capture), capture, who="sense()") for capture in views]


def reports_every_view_as_its_own(settings: Any, folder: Path) -> None:
    for seen in _observations(settings, folder, hard()):
        if seen.depth is not None:
            known = seen.depth[~np.isnan(seen.depth)]
            assert np.all(np.isfinite(known) & (known > 0)), "unknown depth must be NaN, never 0, negative or infinite"


def keeps_what_it_promises(settings: Any, folder: Path) -> None:
    first = _observations(settings, folder, hard()[:1])[0]
    for word in ("image", "depth", "scan", "wheel", "command"):
        if word in type(settings).provides:
            assert getattr(first, word) is not None, f"provides {word}, but the observation has none"
    if "depth" not in type(settings).provides:
        assert first.depth is None, "hands on depth without providing it"


def the_image_is_the_view(settings: Any, folder: Path) -> None:
    views = [capture for _, capture in captures()]
    for before, capture, seen in zip(views[:-1], views[1:], _observations(settings, folder, views)[1:], strict=True):
        if seen.image is None or capture.image is None or seen.image.shape != capture.image.shape:
            continue
        assert before.image is not None
        wrong = {"mirrored": capture.image[:, ::-1], "upside down": capture.image[::-1], "BGR": capture.image[:, :, ::-1],
                 "the view before": before.image}
        own = _apart(seen.image, capture.image)
        for name, other in wrong.items():
            assert own <= _apart(seen.image, other), f"the image looks more like {name} than like the view"
        assert own < 40.0, f"the image is {own:.0f} grey levels off the view in the mean"


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a.astype(float) - b).mean())


def depth_is_metres_along_the_optical_axis(settings: Any, folder: Path) -> None:
    views = [capture for _, capture in captures()]
    for capture, seen in zip(views, _observations(settings, folder, views), strict=True):
        if seen.depth is None or capture.depth is None or seen.depth.shape != capture.depth.shape:
            continue
        ratio = (seen.depth / capture.depth)[np.isfinite(seen.depth)]
        assert len(ratio) > 0.2 * capture.depth.size, f"knows the depth of {len(ratio)} of {capture.depth.size} pixels"
        share = float(np.mean(np.abs(ratio - 1.0) < DEPTH_SHARE))
        assert share > 0.8, f"{share:.0%} of the depths are right, the median is {np.median(ratio):.3g} of the truth"


def scans_end_at_the_walls(settings: Any, folder: Path) -> None:
    views = [capture for _, capture in captures()]
    for (pose, _), seen in zip(captures(), _observations(settings, folder, views), strict=True):
        if seen.scan is None:
            continue
        true = ranges(NEAR_THE_LEFT_WALL, pose, seen.scan.bearings_rad, seen.scan.origin_xy_m)
        known = np.isfinite(seen.scan.ranges_m)
        assert known.sum() > 0.2 * len(known), f"knows {known.sum()} of {len(known)} ranges"
        said = seen.scan.ranges_m[known]
        share = float(np.mean(np.abs(said - true[known]) < RANGE_SHARE * true[known] + RANGE_M))
        assert share > 0.8, (f"{share:.0%} of the beams end at a wall of the room, the median is "
                             f"{np.median(said / true[known]):.3g} of the truth; bearings are left positive, ranges metres "
                             "from origin_xy_m")


def wheels_and_commands_are_those_of_the_drive(settings: Any, folder: Path) -> None:
    views = [capture for _, capture in captures()]
    seen = _observations(settings, folder, views)
    for capture, view in zip(views, seen, strict=True):
        assert view.command is None or view.command == capture.command or view.command is capture.command, (
            "the command is not the capture's")
    pairs = [(view.wheel, capture.travel) for capture, view in zip(views, seen, strict=True) if view.wheel is not None]
    if pairs:
        said, true = (np.sum(values, axis=0) for values in zip(*pairs, strict=True))
        assert np.all(np.abs(said - true) < 0.2 * np.abs(true) + 0.05), (
            f"wheels count {np.round(said, 3)} of a drive of {np.round(true, 3)} (metres ahead, to the left, radians)")


def same_seed_same_observations_whoever_else_is_built(settings: Any, folder: Path) -> None:
    views = hard()
    alone = _observations(settings, folder, views, seed=3)
    part, other = (complete("sensor", settings.build(context(folder, seed, NEAR_THE_LEFT_WALL))) for seed in (3, 4))
    for capture, a in zip(views, alone, strict=True):
        other.sense(capture)
        b = part.sense(capture)
        for name in ("image", "depth", "wheel"):
            assert same(getattr(a, name), getattr(b, name)), f"two builds with one seed differ in {name}"
        assert (a.scan is None) == (b.scan is None)
        assert a.scan is None or same(a.scan.ranges_m, b.scan.ranges_m), "two builds with one seed differ in the scan"


SENSOR = (reports_every_view_as_its_own, keeps_what_it_promises, the_image_is_the_view,
          depth_is_metres_along_the_optical_axis, scans_end_at_the_walls, wheels_and_commands_are_those_of_the_drive,
          same_seed_same_observations_whoever_else_is_built)
