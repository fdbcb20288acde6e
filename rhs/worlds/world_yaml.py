"""Worlds and other files that people write: data only, every value knows its line, nothing is guessed.

Unlike a plain YAML loader this one refuses duplicate keys, aliases and tags, and does not turn `no` into False, `012`
into 10 or `12:30` into 750: a value is what the reader of the file sees. rhs.strict_yaml reads plain dictionaries.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rhs.base.errors import ConfigError
from rhs.base.strict_yaml import one_line, read_text

MAX_BYTES = 1_000_000
FAR_M = 1e7  # a place on a map grid, such as UTM
_NUMBER = re.compile(r"[-+]?(0|[1-9][0-9]*)(\.[0-9]*)?([eE][-+]?[0-9]+)?|[-+]?\.[0-9]+([eE][-+]?[0-9]+)?")


def read_yaml(path: Path) -> Section:
    """The top-level mapping of a file. Raises ConfigError naming file and line."""
    try:
        loader = _Loader(read_text(path, MAX_BYTES))
        loader.name = str(path)
        node = loader.get_single_node()
    except yaml.YAMLError as error:
        raise ConfigError(one_line(error, str(path))) from error
    if node is None:
        raise ConfigError(f"{path}: the file is empty; expected keys and values")
    return Section(node, "the file")


def no_keys(path: Path) -> Section:
    """The keys of a file that is no YAML: none; errors name the file."""
    mark = yaml.Mark(str(path), 0, 0, 0, None, None)
    return Section(yaml.MappingNode("tag:yaml.org,2002:map", [], mark), "the file")


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
    """The standard loader's parser; aliases are refused because they make files hard to read and easy to explode."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.MarkedYAMLError(problem="aliases (*name) are not used here; write the value", problem_mark=mark)
        return super().compose_node(parent, index)


class Section:
    """A mapping of the file. Take each key once with the method of its type; `finish` refuses the rest."""

    def __init__(self, node: yaml.Node, name: str) -> None:
        self.node, self.name = node, name
        if not isinstance(node, yaml.MappingNode):
            raise ConfigError(f"{_where(node)}: {name} is {_kind(node)}; expected keys and values")
        _refuse_tag(node)
        self.nodes: dict[str, yaml.Node] = {}
        for key_node, value in node.value:
            key = _text(key_node)
            if key in self.nodes:
                raise ConfigError(f"{_where(key_node)}: key '{key}' appears twice in {name}")
            self.nodes[key] = value
        self.taken: set[str] = set()

    def where(self, key: str) -> str:
        """file:line of a key, for messages."""
        return _where(self.nodes.get(key, self.node))

    def inherit(self, base: Section) -> None:
        """Take from another file the keys that this one lacks."""
        self.nodes = {**base.nodes, **self.nodes}

    def put(self, values: Mapping[str, Any]) -> Section:
        """Set these keys to numbers, or lists of such, whatever the file says of them."""
        for key, value in values.items():
            self.nodes[key] = self._node(value)
        return self

    def _node(self, value: Any) -> yaml.Node:
        mark = self.node.start_mark
        if isinstance(value, (list, tuple)):
            return yaml.SequenceNode("tag:yaml.org,2002:seq", [self._node(item) for item in value], mark, mark)
        return yaml.ScalarNode("tag:yaml.org,2002:float", repr(float(value)), mark)

    def keys(self) -> list[str]:
        return list(self.nodes)

    def number(self, key: str, default: float | None = None, *, low: float = -1e6, high: float = 1e6) -> float:
        """A finite number in [low, high]; a default of None makes the key required."""
        node = self._take(key, required=default is None)
        if node is None:
            return float(default)  # type: ignore[arg-type]
        return _number(key, node, (low, high))

    def whole(self, key: str, default: int | None = None, *, low: int = 0, high: int = 10**6) -> int:
        """A whole number in [low, high]."""
        value = self.number(key, default, low=low, high=high)
        if value != int(value):
            raise ConfigError(f"{self.where(key)}: {key}: {value} is not a whole number")
        return int(value)

    def text(self, key: str, default: str | None = None, *, choices: Iterable[str] = ()) -> str:
        """A word or sentence, one of `choices` if there are any."""
        node = self._take(key, required=default is None)
        value = str(default) if node is None else _text(node)
        allowed = list(choices)
        if allowed and value not in allowed:
            raise ConfigError(f"{self.where(key)}: {key}: '{value}' is not one of {', '.join(allowed)}")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """true or false, in these very words."""
        return self.text(key, str(default).lower(), choices=("true", "false")) == "true"

    def numbers(self, key: str, default: Iterable[float] | None = None, *, count: int | None = None,
                low: float = -1e6, high: float = 1e6) -> list[float]:
        """A list of numbers in [low, high], of the given length if there is one."""
        node = self._take(key, required=default is None)
        if node is None:
            return [float(v) for v in default or ()]
        items = self._items(key, node)
        if count is not None and len(items) != count:
            raise ConfigError(f"{self.where(key)}: {key} has {len(items)} values; expected {count}")
        return [_number(key, item, (low, high)) for item in items]

    def points(self, key: str, *, least: int = 2) -> np.ndarray:
        """(N, 2) points, written [[x, y], [x, y], ...]."""
        node = self._take(key, required=True)
        rows = []
        for item in self._items(key, node):
            if not isinstance(item, yaml.SequenceNode) or len(item.value) != 2:
                raise ConfigError(f"{_where(item)}: {key}: expected points such as [2.0, 1.0], found {_kind(item)}")
            rows.append([_number(key, value, (-FAR_M, FAR_M)) for value in item.value])
        if len(rows) < least:
            raise ConfigError(f"{self.where(key)}: {key} has {len(rows)} points; expected at least {least}")
        return np.array(rows, float).reshape(-1, 2)

    def texts(self, key: str) -> list[str]:
        """A list of words or sentences; empty if the key is absent."""
        node = self._take(key, required=False)
        return [] if node is None else [_text(item) for item in self._items(key, node)]

    def section(self, key: str) -> Section:
        """A mapping inside this one; an empty one if the key is absent."""
        node = self._take(key, required=False)
        if node is None:
            node = yaml.MappingNode("tag:yaml.org,2002:map", [], self.node.start_mark)
        return Section(node, key)

    def sections(self, key: str, *, required: bool = False) -> list[Section]:
        """A list of mappings; empty if the key is absent."""
        node = self._take(key, required=required)
        return [] if node is None else [Section(n, f"{key} entry {i + 1}")
                                        for i, n in enumerate(self._items(key, node))]

    def finish(self) -> None:
        """Refuse the keys that nobody took."""
        for key in self.nodes:
            if key not in self.taken:
                near = difflib.get_close_matches(key, sorted(self.taken), n=1, cutoff=0.5)
                advice = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(sorted(self.taken))}"
                raise ConfigError(f"{self.where(key)}: unknown key '{key}' in {self.name}; {advice}")

    def _take(self, key: str, *, required: bool) -> yaml.Node | None:
        self.taken.add(key)
        node = self.nodes.get(key)
        if node is None and required:
            near = difflib.get_close_matches(key, [k for k in self.nodes if k not in self.taken], n=1, cutoff=0.6)
            advice = f"; did you mean it by '{near[0]}'?" if near else ""
            raise ConfigError(f"{_where(self.node)}: {self.name} lacks the key '{key}'{advice}")
        return node

    def _items(self, key: str, node: yaml.Node | None) -> list[yaml.Node]:
        if not isinstance(node, yaml.SequenceNode):
            raise ConfigError(f"{self.where(key)}: {key} is {_kind(node)}; expected a list")
        _refuse_tag(node)
        items: list[yaml.Node] = node.value
        return items


def _where(node: yaml.Node) -> str:
    return f"{node.start_mark.name}:{node.start_mark.line + 1}"


def _number(key: str, node: yaml.Node, limits: tuple[float, float]) -> float:
    where, (low, high) = _where(node), limits
    text = node.value if isinstance(node, yaml.ScalarNode) else None
    if text is None or node.style is not None or not node.tag.startswith("tag:yaml.org,2002:"):
        raise ConfigError(f"{where}: {key} is {_kind(node)}; expected a number")
    if not _NUMBER.fullmatch(text):
        raise ConfigError(f"{where}: {key}: '{text}' is not a number; expected one such as 2.5 (finite, no leading 0)")
    value = float(text)
    if not low <= value <= high:
        raise ConfigError(f"{where}: {key}={text} is outside the allowed range [{low:g}, {high:g}]")
    return value


def _text(node: yaml.Node) -> str:
    _refuse_tag(node)
    if not isinstance(node, yaml.ScalarNode) or not node.value:
        raise ConfigError(f"{_where(node)}: expected a word, found {_kind(node)}")
    return str(node.value)


_PLAIN_TAGS = {f"tag:yaml.org,2002:{t}" for t in ("str", "int", "float", "bool", "null", "map", "seq", "timestamp")}


def _refuse_tag(node: yaml.Node) -> None:
    if node.tag not in _PLAIN_TAGS:
        raise ConfigError(f"{_where(node)}: tag '{node.tag}' is not allowed: files hold data only")


def _kind(node: yaml.Node | None) -> str:
    if isinstance(node, yaml.MappingNode):
        return "a group of keys"
    if isinstance(node, yaml.SequenceNode):
        return "a list"
    return f"'{node.value}'" if node is not None and node.value else "empty"
