"""What degradations must do (see rhs.testing)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.geometry import Camera, inverse
from rhs.api.records import Capture
from rhs.api.validate import check_capture

from .room import CAMERA, context
from .sensors import captures
from .shared_state import same, untouched


def _spoiled(settings: Any, folder: Path) -> list[Capture | None]:
    """The views of the small room as they arrive, each with the true motion before it."""
    part = complete("degrade", settings.build(context(folder)))
    out, previous = [], captures()[0][0]
    for pose, capture in captures():
        with untouched(capture):
            spoiled = part.degrade(capture, inverse(previous) @ pose)
        out.append(None if spoiled is None else check_capture(spoiled, who="degrade()"))
        previous = pose
    return out


def hands_on_each_view_as_itself_or_none(settings: Any, folder: Path) -> None:
    """Index and stamp stay, the picture keeps its size, nothing is added that was not there."""
    for spoiled, (_, capture) in zip(_spoiled(settings, folder), captures(), strict=True):
        if spoiled is None:
            continue
        assert (spoiled.index, spoiled.stamp_s) == (capture.index, capture.stamp_s), "index and stamp_s must stay"
        for name in ("image", "depth"):
            before, after = getattr(capture, name), getattr(spoiled, name)
            assert after is None or np.shape(after) == np.shape(before), f"{name} changed its shape"


def same_seed_same_views(settings: Any, folder: Path) -> None:
    for one, other in zip(_spoiled(settings, folder), _spoiled(settings, folder), strict=True):
        assert (one is None) == (other is None), "two builds with one seed lost different views; draw from context.rng only"
        for name in ("image", "depth", "travel"):
            assert one is None or other is None or same(getattr(one, name), getattr(other, name)), (
                f"two builds with one seed differ in {name}; draw from context.rng only")


def tells_a_camera_of_the_same_size(settings: Any, folder: Path) -> None:
    camera = complete("degrade", settings.build(context(folder))).told(CAMERA)
    assert isinstance(camera, Camera) and (camera.width, camera.height) == (CAMERA.width, CAMERA.height), (
        f"told() must return a Camera of {CAMERA.width}x{CAMERA.height}; derive from rhs.api.contracts.Degradation")


DEGRADE = (hands_on_each_view_as_itself_or_none, same_seed_same_views, tells_a_camera_of_the_same_size)
