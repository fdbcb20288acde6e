"""Which sensor suits a recording, where nobody typed one and it has no colour with depth."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from rhs.api.errors import ConfigError, RecordingError
from rhs.api.stereo import RIGHT_IMAGE

from .bags.held import held_in_bag
from .replay import USED_BY, format_of, open_recording

SUITED = {"scan": "laser", "cloud": "lidar", RIGHT_IMAGE: "stereo", "image": "mono"}  # the first of these that is there
MOST_KEPT = 256  # answers, for the jobs of a sweep
log = logging.getLogger("rhs.replay")
_answers: dict[tuple[str, int], str] = {}
ALONE = {"carmen": "scan", "clouds": "cloud", "video": "image"}  # told by the format, without opening anything


def suited_sensor(settings) -> str:
    """`laser`, `lidar`, `stereo` or `mono`; empty where there is colour with depth, or nothing that can be read.

    A recording is opened once for all jobs that read it alike, as long as its file or folder stays as it is."""
    path = Path(settings.path).expanduser()
    if not settings.path or not (path.is_dir() or path.is_file()):
        return ""
    asked = repr(settings), path.stat().st_mtime_ns
    if asked not in _answers:
        if len(_answers) >= MOST_KEPT:
            _answers.clear()
        _answers[asked] = _looked_up(path, settings)
    return _answers[asked]


def _looked_up(path: Path, settings) -> str:
    log.disabled, before = True, log.disabled  # what there is to say is said where the recording is opened to be used
    try:
        held = _held(path, settings)
    except (ConfigError, RecordingError):
        return ""
    finally:
        log.disabled = before
    if {"image", "depth"} <= held:
        return ""
    return next((sensor for word, sensor in SUITED.items() if word in held), "")


def _held(path: Path, settings) -> frozenset[str]:
    """What the views may hold, in the words of a part's needs; of two cameras `right_image` too."""
    kind = format_of(path) if settings.format == "auto" else settings.format
    if kind in ALONE:
        return frozenset({ALONE[kind]})
    if kind == "bag":
        return held_in_bag(path, settings)
    if kind in USED_BY["stereo"]:
        try:
            return open_recording(replace(settings, stereo=True)).provides
        except ConfigError:  # one camera
            pass
    return open_recording(settings).provides
