"""A configuration that a run left behind, with other words laid over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .compose import RunConfig, from_plain
from .overrides import parse, plain_words


def overlaid(values: Mapping[str, Any], words: Sequence[str]) -> RunConfig:
    """The checked configuration of plain values (a config.yaml read back) after `key=value` words; `kind=name` takes that
    part with its defaults. Raises ConfigError."""
    laid: dict[str, Any] = dict(values)
    for word in plain_words(parse(list(words))):
        *above, last = word.key.split(".")
        node = laid
        for key in above:
            node[key] = dict(node.get(key) or {})
            node = node[key]
        node[last] = {"name": word.value} if word.is_group and word.key != "task" else word.value
    return from_plain(laid)
