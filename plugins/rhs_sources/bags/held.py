"""What a bag holds, before any of its sensors is chosen."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path

from rhs.api.errors import ConfigError

from . import messages as ros
from .files import opened
from .topics import IMAGES, choose_topics


def held_in_bag(path: Path, settings) -> frozenset[str]:
    """What the views of a bag may hold, whichever of its sensors makes them, in the words of a part's needs."""
    reader = opened(path)
    try:
        found = topics_in(reader)
        encodings = encodings_in(reader, found)
    finally:
        reader.close()
    held: frozenset[str] = frozenset()
    typed = settings.color_topic or settings.depth_topic
    for views in (settings.views,) if typed else (settings.views, "scans", "clouds"):
        with suppress(ConfigError):
            held |= choose_topics(found, replace(settings, views=views), str(path), encodings).provide()
    if not typed and "depth" not in held:
        with suppress(ConfigError):
            held |= choose_topics(found, replace(settings, stereo=True), str(path), encodings).provide()
    return held


def topics_in(reader) -> dict[str, str]:
    """Topic -> type, but for those that the recorder listed and never heard."""
    counted = any(info.msgcount for info in reader.topics.values())
    return {topic: info.msgtype for topic, info in reader.topics.items() if info.msgcount or not counted}


def encodings_in(reader, found: dict[str, str]) -> dict[str, str]:
    """Of the first image of each topic of raw ones."""
    out = {}
    for topic in (topic for topic, kind in found.items() if kind == IMAGES[0]):
        with suppress(ros.UnreadableBag):  # said where it is read
            for _, _, message in islice(ros.stamped(reader, {topic}), 1):
                out[topic] = str(message.encoding)
    return out
