"""What sources and sensors must do (see rhs.testing)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import SourceContext
from rhs.api.records import Capture, Observation, Scan, Twist
from rhs.base.errors import ConfigError
from rhs.worlds.world import load_world

from .estimators import check_pose, drive
from .room import CAMERA, context, paintings, scan_of, see

WORLD = "square_small"


def captures() -> list[Capture]:
    """Ideal views of the room, then one without content, then one without known depth. Nothing may be written to."""
    textures, out = paintings(), []
    for index, (pose, seen) in enumerate(drive()):
        out.append(replace(see(CAMERA, pose, textures, index), travel=seen.wheel, command=Twist(0.5, 0.1, 0.2),
                           scan=scan_of(pose)))
    blank = replace(out[-1], index=len(out), image=np.full_like(out[-1].image, 90))
    dark = replace(out[-1], index=len(out) + 1, depth=np.full_like(out[-1].depth, np.nan))
    out += [blank, dark]
    for capture in out:
        for array in (capture.image, capture.depth):
            if array is not None:
                array.setflags(write=False)
    return out


def _observations(settings: Any, folder: Path, seed: int = 0) -> list[Observation]:
    sensor = settings.build(context(folder, seed))
    return [sensor.sense(capture) for capture in captures()]


def reports_what_the_camera_saw(settings: Any, folder: Path) -> None:
    for capture, seen in zip(captures(), _observations(settings, folder), strict=True):
        assert isinstance(seen, Observation), f"sense() returned {type(seen).__name__}, expected an Observation"
        assert (seen.index, seen.stamp_s) == (capture.index, capture.stamp_s), "index and stamp must be the capture's"
        size = (seen.camera.height, seen.camera.width)
        if seen.image is not None:
            assert seen.image.shape[:2] == size and seen.image.dtype == np.uint8, f"image: {seen.image.shape}"
        if seen.depth is not None:
            known = seen.depth[~np.isnan(seen.depth)]
            assert seen.depth.shape == size, f"depth has shape {seen.depth.shape}, the camera {size}"
            assert np.all(np.isfinite(known) & (known > 0)), "unknown depth must be NaN, never 0, negative or infinite"
        if seen.scan is not None:
            check_scan(seen.scan)


def check_scan(scan: Scan) -> None:
    assert scan.bearings_rad.shape == scan.ranges_m.shape, "as many ranges as bearings"
    assert np.all(np.isfinite(scan.bearings_rad)), "bearings must be finite"
    known = scan.ranges_m[~np.isnan(scan.ranges_m)]
    assert np.all(known > 0), "ranges must be positive, NaN (unknown) or infinite (nothing there)"


def keeps_what_it_promises(settings: Any, folder: Path) -> None:
    first = _observations(settings, folder)[0]
    for word in ("image", "depth", "scan", "wheel", "command"):
        if word in type(settings).provides:
            assert getattr(first, word) is not None, f"provides {word}, but the observation has none"
    if "depth" not in type(settings).provides:
        assert first.depth is None, "hands on depth without providing it"


def hands_out_arrays_nobody_can_change(settings: Any, folder: Path) -> None:
    for seen in _observations(settings, folder)[:2]:
        for name in ("image", "depth", "wheel"):
            array = getattr(seen, name)
            assert array is None or not array.flags.writeable, f"{name} can be written to; set its write flag to False"


def same_seed_same_observations(settings: Any, folder: Path) -> None:
    first, second = (_observations(settings, folder, seed=3) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        for name in ("image", "depth", "wheel"):
            left, right = getattr(a, name), getattr(b, name)
            assert (left is None) == (right is None)
            assert left is None or np.array_equal(left, right, equal_nan=name != "image"), f"{name} differs"


SENSOR = (reports_what_the_camera_saw, keeps_what_it_promises, hands_out_arrays_nobody_can_change,
          same_seed_same_observations)


def _source(settings: Any, folder: Path) -> Any:
    """The source, in a small world if it can be driven; None when a recording asks for a file first."""
    driven = "driving" in type(settings).provides
    world = load_world(WORLD) if driven else None
    try:
        return settings.build(SourceContext(np.random.default_rng(0), world, folder))
    except ConfigError:
        if driven:
            raise
        return None


def hands_out_views_of_its_camera(settings: Any, folder: Path) -> None:
    source = _source(settings, folder)
    if source is None:
        return
    try:
        views = [source.lead() for _ in range(3)]
        stamps = [view.stamp_s for view in views if view is not None]
        assert all(a < b for a, b in zip(stamps[:-1], stamps[1:], strict=True)), f"stamps do not grow: {stamps}"
        for view in views:
            if view is not None and view.image is not None:
                assert view.image.shape[:2] == (source.camera.height, source.camera.width)
        if (truth := source.truth()) is not None:
            check_pose(truth, "truth()")
        assert source.facts.robot_radius_m >= 0
    finally:
        source.close()


def drives_when_told(settings: Any, folder: Path) -> None:
    if "driving" not in type(settings).provides:
        return
    source = _source(settings, folder)
    try:
        source.lead()
        source.begin_patrol()
        before = source.truth()
        view = source.drive(Twist(0.25, 0.0, 0.4))
        assert isinstance(view, Capture), f"drive() returned {type(view).__name__}, expected a Capture"
        moved = np.linalg.norm(source.truth()[:2, 3] - before[:2, 3])
        assert abs(moved - 0.1) < 0.02, f"0.25 m/s for 0.4 s moved it by {moved:.3f} m"
    finally:
        source.close()


SOURCE = (hands_out_views_of_its_camera, drives_when_told)
