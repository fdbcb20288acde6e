"""Video files (mp4, avi, mkv, mov, webm) by OpenCV: colour alone, for `sensor=mono`; one view is decoded at a time.

Stamps are the container's, or the views come at `source.rate_hz`. A stamp that does not ascend is put one frame after the
one before, and counted as repaired. Truth: `source.truth=FILE`.
"""

from __future__ import annotations

import logging
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse
from rhs.api.pictures import MOST_PIXELS
from rhs.api.records import Capture

from ..replay_cameras import chosen_camera
from ..replay_mounts import placed_camera
from ..replay_tum import Recording
from .intrinsics import intrinsics_beside
from .views import moved, truth_of

SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v")
CUT_SHARE = 0.9  # of the pictures a container tells of; it may guess at their number
KINECT, HEAD_BYTES = b"K4A_DEPTH_", 1 << 20  # tags that k4arecorder writes
RATE_HZ = 30.0  # where the container names none


log = logging.getLogger("rhs.replay")


def is_video(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in SUFFIXES


def open_video(path: Path, settings) -> Recording:
    """The views of a video file. Raises ConfigError for one that holds no picture."""
    import cv2

    with path.open("rb") as file:
        if KINECT in file.read(HEAD_BYTES):
            log.warning("%s: a recording of an Azure Kinect, of which only colour is read; for its depth unpack it by "
                        "Open3D's azure_kinect_mkv_reader.py --input %s --output FOLDER, then source.path=FOLDER",
                        path.name, path.name)
    video = _video(path)
    size = (int(video.get(cv2.CAP_PROP_FRAME_WIDTH)), int(video.get(cv2.CAP_PROP_FRAME_HEIGHT)))
    told_hz, total = video.get(cv2.CAP_PROP_FPS), int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    rate_hz = settings.rate_hz or (told_hz if 0.0 < told_hz < 1e4 else RATE_HZ)
    recorded = intrinsics_beside(path.parent, size) if settings.camera == "auto" else None
    camera = placed_camera(chosen_camera(settings.camera, size, recorded=recorded, where=str(path)), settings)
    if 0 < total <= settings.start:
        raise ConfigError(f"{path}: source.start={settings.start} but the recording has {total} views")
    repaired: Counter = Counter()
    lost: list[str] = []
    true, rejected = truth_of(None, settings)
    camera_from_body = inverse(camera.body_from_camera)

    def views():
        try:
            for index, (line, stamp, image) in enumerate(_frames(video, settings, rate_hz, repaired, lost)):
                yield Capture(index, stamp, image=image, sensed=True), moved(true(line, stamp), camera_from_body)
        finally:
            video.release()

    expected = len(range(total)[settings.start :: settings.stride][: settings.count or None]) if total > 0 else None
    return Recording(camera, views(), expected, rejected, provides=frozenset({"image", "gray"}), lost=lost,
                     repaired=repaired)


def _frames(video, settings, rate_hz: float, repaired: Counter,
            lost: list[str]) -> Iterator[tuple[int, float, np.ndarray]]:
    """(number, stamp, RGB image) of the views that start, stride and count choose."""
    import cv2

    number, taken, stamp = 0, 0, -np.inf
    while video.grab() and not (settings.count and taken == settings.count):
        told_s = number / rate_hz if settings.rate_hz else 1e-3 * video.get(cv2.CAP_PROP_POS_MSEC)
        if number and not told_s > stamp:
            repaired["backward"] += 1
        stamp = told_s if told_s > stamp else stamp + 1.0 / rate_hz
        if number >= settings.start and (number - settings.start) % settings.stride == 0:
            there, image = video.retrieve()
            if there:
                taken += 1
                yield number, stamp, np.ascontiguousarray(image[:, :, ::-1])
        number += 1
    claimed = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    if not (settings.count and taken == settings.count) and number < CUT_SHARE * claimed:
        lost[:] = [f"the video is cut: {number} of {claimed} pictures"]


def _video(path: Path):
    """An open video whose first picture can be read."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # what is wrong is said here, in one line
    import cv2

    video = cv2.VideoCapture(str(path))
    pixels = video.get(cv2.CAP_PROP_FRAME_WIDTH) * video.get(cv2.CAP_PROP_FRAME_HEIGHT)
    if video.isOpened() and 0 < pixels <= MOST_PIXELS and video.read()[0]:
        video.release()
        return cv2.VideoCapture(str(path))  # from the beginning again
    video.release()
    size = f"a video of {pixels:.0f} pixels a view"
    found = size if pixels > MOST_PIXELS else f"{path.stat().st_size} bytes that are no video"
    raise ConfigError(f"{path}: found {found}; expected pictures that OpenCV decodes")
