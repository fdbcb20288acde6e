"""One run from Python: words or objects in, steps or a row out."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rhs.api import settings
from rhs.api.contracts import PLUGIN_KINDS
from rhs.api.records import Step
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.config.compose import Composer, RunConfig
from rhs.config.loose import check_not_being_read
from rhs.config.overrides import GROUPS, Word, parse, plain_words
from rhs.runfolder.folders import claim_run

from .left_over import left_as_found
from .observers import bar, in_notebook, unwatched
from .run import run_config, run_steps


def run_words(words: Sequence[str] | Mapping[str, Any], *, quiet: bool = False) -> dict[str, Any]:
    """rhs.run."""
    config = config_of(words)
    with claim_run(config.output, seed=config.seed, overwrite=config.overwrite) as claim:
        with left_as_found(config):
            row = run_config(config, claim.folder, unwatched if quiet else bar)
        cause = row.pop("_cause", None)
        folder = claim.publish()
        if isinstance(cause, KeyboardInterrupt):  # who stops a loop over runs stops the loop
            raise cause
        if not quiet:
            show_in_notebook(folder)
        return row | {"folder": str(folder)}


def steps_of(words: Sequence[str] | Mapping[str, Any]) -> Iterator[Step]:
    """rhs.steps: words that are refused are refused now, not when the first step is asked for."""
    return _steps(config_of(words))


def _steps(config: RunConfig) -> Iterator[Step]:
    """The steps of a run. What ends it is raised again when its row is written."""
    with claim_run(config.output, seed=config.seed, overwrite=config.overwrite) as claim:
        row = yield from run_steps(config, claim.folder)
        claim.publish()
        if row["_cause"] is not None:
            raise row["_cause"]


def config_of(words: Sequence[str] | Mapping[str, Any]) -> RunConfig:
    """The checked configuration for words, or for a mapping whose values may be objects. Raises ConfigError."""
    check_words(words)
    found = words_of(words) if isinstance(words, Mapping) else plain_words(parse(list(words)))
    return Composer().config(found)


def check_words(words: Sequence[str] | Mapping[str, Any]) -> None:
    """Raises ConfigError for what are no words, and in a file that is only being read for its plugins."""
    check_not_being_read()
    if isinstance(words, str):
        raise ConfigError(f"'{words}' is one text; give a list of words, [\"key=value\", ...]")
    if not isinstance(words, Sequence | Mapping) or not all(isinstance(word, str) for word in words):
        raise ConfigError(f"{str(words)[:60]}: expected a list of words, [\"key=value\", ...], or a mapping")


def words_of(values: Mapping[str, Any]) -> list[Word]:
    """A mapping as words; a settings object of a part is registered by its class's name, if nobody knows it yet."""
    out: list[Word] = []
    for key, value in values.items():
        if key in PLUGIN_KINDS and settings.is_record(value):
            name = known_as(key, type(value))
            check_dicts(key, settings.plain(value), settings.defaults(type(value)))
            out.append(Word(key, name, f"{key}={name}"))
            out += [Word(f"{key}.{k}", v, f"{key}.{k}={v}") for k, v in settings.plain(value).items()]
        else:
            check_value(key, value)
            out.append(Word(key, settings.plain(value), f"{key}={value}"))
    return [word for word in out if word.key in GROUPS] + [word for word in out if word.key not in GROUPS]


def check_value(key: str, value: Any) -> None:
    """Raises ConfigError for a class, and for an object in the place of a part that is no dataclass."""
    if isinstance(value, type):
        raise ConfigError(f"{key}: {value.__name__} is a class; give an object of it, {value.__name__}()")
    if key in PLUGIN_KINDS and not isinstance(value, str | Mapping | None):
        raise ConfigError(f"{key}: found an object of {type(value).__name__}; expected a name, or an object of a dataclass "
                          f"that has build(context)")


def check_dicts(owner: str, values: Mapping[str, Any], base: Mapping[str, Any]) -> None:
    """Raises ConfigError where a dict of an object lacks keys of its class's default: words can add keys and take none away,
    so that another object would be built. values, base: the settings of the object, and of its class, as plain values."""
    for key, default in base.items():
        if key not in values:
            raise ConfigError(f"{owner} lacks the key {key} of its class's default, which words cannot take away; give the "
                              f"setting an empty default")
        if isinstance(default, Mapping) and isinstance(values[key], Mapping):
            check_dicts(f"{owner}.{key}", values[key], default)


def known_as(kind: str, cls: type) -> str:
    """The name by which this class is registered; it is registered now if it is not, or if that is what the class was before
    its cell of a notebook was run again. Nobody else's name is taken."""
    taken = registry.names(kind)
    for name in taken:
        if any(origin.value == f"{cls.__module__}:{cls.__qualname__}" for origin in registry.origins(kind, name)):
            if registry.load(kind, name) is not cls:
                registry.register(kind, name, cls)
            return name
    word = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", cls.__name__).lower()
    names = itertools.chain([word], (f"{word}_{k}" for k in itertools.count(2)))
    name = next(name for name in names if name not in taken)
    registry.register(kind, name, cls)
    return name


def show_in_notebook(folder: Path) -> None:
    """The overview picture, or what a task draws in its place, where somebody looks at a notebook."""
    pictures = sorted(folder.glob("*.png"), key=lambda path: path.name != "overview.png")
    if pictures and in_notebook():
        from IPython.display import Image, display  # type: ignore[import-not-found,unused-ignore]

        display(Image(filename=str(pictures[0])))


