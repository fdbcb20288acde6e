"""The words of a sweep that are none of its runs': where its jobs run and what stays of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rhs.api import settings
from rhs.api.engine import HERE
from rhs.base.errors import ConfigError, check_choice
from rhs.config import registry
from rhs.config.overrides import is_of_sweep, parse, plain_words

from .survey_cache import most_mb

KEEP = ("all", "failures", "none")
ALL_UP_TO = 1000  # jobs of which every folder is kept unless something else is said
DEFAULT = "process"


@dataclass(frozen=True)
class Choice:
    """engine: its name. settings: its dataclass. keep: whose folders stay. share: whether jobs share surveys.
    cache: whether surveys are taken from earlier sweeps, and kept for later ones."""

    engine: str
    settings: Any
    keep: str
    share: bool = True
    cache: bool = True

    @property
    def here(self) -> bool:
        """Whether the sweep's own process starts the jobs."""
        return HERE in self.settings.provides


def split(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The words of the sweep, and those of its runs."""
    of_sweep = [word for word in words if is_of_sweep(word.partition("=")[0])]
    return of_sweep, [word for word in words if word not in of_sweep]


def choose(words: Sequence[str], count: int) -> Choice:
    """The engine and what is kept of `count` jobs. Raises ConfigError in one line."""
    name, keep, values = DEFAULT, "all" if count <= ALL_UP_TO else "failures", {}
    switches = {"share": True, "cache": True}
    for word in plain_words(parse(words)):
        key, _, below = word.key.partition(".")
        if word.key == "keep":
            keep = word.value
        elif word.key in switches:
            if not isinstance(word.value, bool):
                raise ConfigError(f"{word.text}: expected true or false")
            switches[word.key] = word.value
        elif below:
            values[below] = word.value
        elif isinstance(word.value, str):
            name = word.value
        else:
            raise ConfigError(f"{word.text}: choose one of {', '.join(registry.names('engine'))} by engine=NAME")
    check_choice("", "keep", keep, KEEP)
    switches["cache"] = switches["cache"] and most_mb() > 0.0
    cls = registry.load("engine", name)
    registry.check_requirements("engine", name, cls)
    return Choice(name, settings.make(cls, values, "engine"), keep, **switches)
