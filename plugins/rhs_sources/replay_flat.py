"""Recordings whose lens sees too far aside for any model of OpenCV's: their images are made those of a pinhole camera."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera
from rhs.api.records import Capture
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

from .lens_models import Flattened
from .replay_tum import Recording

log = logging.getLogger("rhs.replay")


def flattened(recording: Recording, where: str) -> Recording:
    """The recording as pinhole cameras see it; itself where its lenses are followed. Said once. Raises ConfigError of one
    with depth, whose pixels would no longer be those of colour."""
    camera, right = recording.camera, recording.right
    if not isinstance(camera, Flattened) and not isinstance(right, Flattened):
        return recording
    if "depth" in recording.provides:
        raise ConfigError(f"source.path={where}: found a lens that sees too far aside beside depth; undistort both alike "
                          "(cv2.fisheye.initUndistortRectifyMap) and type source.camera=[fx,fy,cx,cy]")
    if isinstance(camera, Flattened):
        aside = np.degrees(np.arctan(0.5 * max(camera.width, camera.height) / camera.fx))
        log.warning("%s: its lens (%s) sees further aside than is followed: images are flattened to a pinhole's, %.0f "
                    "degrees to each side", where, camera.model, aside)
    flat = camera.plain() if isinstance(camera, Flattened) else camera
    return replace(recording, camera=flat, right=None, views=_flat_views(recording.views, camera, right))


def _flat_views(views: Iterator[tuple[Capture, np.ndarray | None]], camera: Camera, right: Camera | None):
    for capture, pose in views:
        extras = dict(capture.extras)
        if isinstance(right, Flattened):
            extras |= {RIGHT_IMAGE: right.flat(extras[RIGHT_IMAGE]), RIGHT_CAMERA: camera_numbers(right.plain())}
        image = camera.flat(capture.image) if isinstance(camera, Flattened) and capture.image is not None else capture.image
        yield replace(capture, image=image, extras=extras), pose
