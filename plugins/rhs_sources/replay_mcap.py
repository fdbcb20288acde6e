"""Recordings that rhs wrote (run.mcap), also cut ones: what the sensor reported, bit for bit, and the true poses."""

from __future__ import annotations

import dataclasses
from collections import Counter
from itertools import chain
from pathlib import Path

from rhs.api.errors import ConfigError
from rhs.recording.reader import PARTS, read, read_head

from .replay_tum import Recording


def is_run(path: Path) -> bool:
    """Whether it is a recording by rhs, or the folder of a run that holds one."""
    path = _file(path)
    return path.suffix == ".mcap" and path.is_file() and read_head(path) is not None


def _file(path: Path) -> Path:
    return path / "run.mcap" if path.is_dir() else path


def open_run(path: Path, settings) -> Recording:
    """The views of one phase of a recorded run. A recording without images is refused."""
    path = _file(path)
    head = read_head(path) if path.is_file() else None
    if head is None:
        raise ConfigError(f"{path} is no recording that rhs wrote; leave source.format out")
    if not head.has_images:
        raise ConfigError(f"{path}: recorded with recording={head.level}, which keeps no images; record with "
                          "recording=full to replay")
    facts = head.facts and dataclasses.replace(head.facts, places=())  # a recording cannot be driven to a place
    lost: list[str] = []
    views = _views(path, settings, lost)
    first = next(views)
    capture = first[0]
    held = {"image": capture.image, "gray": capture.image, "depth": capture.depth, "scan": capture.scan}
    provides = frozenset({word for word, what in held.items() if what is not None} | {"wheel"} | set(capture.extras))
    return Recording(head.camera, chain([first], views), None, Counter(), facts, provides, lost, timed=head.timed)


def _views(path: Path, settings, lost: list[str]):
    reading = read(path)
    number = handed_out = 0
    for view in reading.views():
        if settings.phase not in ("all", view.phase):
            continue
        if number >= settings.start and (number - settings.start) % settings.stride == 0:
            yield view.capture, view.truth
            handed_out += 1
            if handed_out == settings.count:
                return
        number += 1
    if not reading.report.whole:
        lost.append(reading.report.words)
    if not handed_out:
        raise ConfigError(f"{path}: holds no complete view of phase {settings.phase} "
                          f"({', '.join(PARTS.values())}); {reading.report.line}")
