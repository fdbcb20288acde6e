"""YAML as people read it: no code, no duplicate keys, and no value that silently becomes another.

YAML 1.1 reads `no` as False, `012` as 10 and `12:30` as 750. Here only `true` and `false` are booleans, numbers are
written in decimal, and everything else is the text that stands there. Every error names file and line.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from .commands import check_regular
from .errors import ConfigError

_INTEGER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)\Z")
_FLOAT = re.compile(r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))(?:[eE][-+]?[0-9]+)?\Z|[-+]?\.inf\Z|\.nan\Z", re.I)
_BOOL = re.compile(r"(?:true|false)\Z", re.I)
_NULL = re.compile(r"(?:~|null|)\Z", re.I)
_LIMIT_BYTES = 64 << 20
_NESTING = 64
_DIGITS = 300  # of a whole number; a float ends there too
_SHORT, _OPENED = 20_000, 500  # characters and openings of a text that may be read in C: what it nests then fits any stack


class _Strict:
    """What both loaders share: YAML 1.2 scalars, no duplicate keys, no endless numbers."""

    def construct_mapping(self, node, deep=False):
        seen = set()
        for key_node, _ in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else None
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"the key '{key}' stands twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)  # type: ignore[misc]

    def construct_yaml_int(self, node):
        text = self.construct_scalar(node)  # type: ignore[attr-defined]
        if len(text) > _DIGITS:
            raise yaml.MarkedYAMLError(problem=f"a number of {len(text)} digits; at most {_DIGITS} are read",
                                       problem_mark=node.start_mark)
        return int(text)


class _Loader(_Strict, yaml.SafeLoader):
    """Also refuses aliases (which make small files explode) and deep nesting."""

    yaml_implicit_resolvers: dict = {}
    depth = 0

    def compose_node(self, parent, index):
        mark = self.peek_event().start_mark
        if self.check_event(yaml.AliasEvent):
            raise yaml.MarkedYAMLError(problem="aliases (*name) are not used here; write the value", problem_mark=mark)
        if self.depth > _NESTING:
            raise yaml.MarkedYAMLError(problem=f"is nested more deeply than {_NESTING} levels", problem_mark=mark)
        self.depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self.depth -= 1


class _InC(_Strict, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """Ten times as fast, for short texts without aliases."""

    yaml_implicit_resolvers: dict = {}


for _loader in (_Loader, _InC):
    for _tag, _pattern in (("bool", _BOOL), ("int", _INTEGER), ("float", _FLOAT), ("null", _NULL)):
        _loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", _pattern, None)
    _loader.add_implicit_resolver("tag:yaml.org,2002:merge", re.compile(r"<<\Z"), ["<"])
    _loader.add_constructor("tag:yaml.org,2002:int", _loader.construct_yaml_int)


def load_yaml(path: Path) -> Any:
    """What the file says, as dict, list, str, int, float, bool or None. Raises ConfigError with file:line."""
    return parse_yaml(read_text(path), str(path))


def read_text(path: Path, most_bytes: int = _LIMIT_BYTES) -> str:
    """The text of a YAML file, with or without byte order mark. Raises ConfigError for what cannot be read or is too big."""
    try:
        check_regular(path)
        if path.stat().st_size > most_bytes:
            raise ConfigError(f"{path}: {path.stat().st_size} bytes is more than the {most_bytes} allowed for a YAML file")
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); expected a YAML file") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8") from error


def parse_yaml(text: str, name: str) -> Any:
    """The content of YAML text; `name` is used in errors."""
    opened = sum(map(text.count, ("[", "{", "- ", "? ")))
    if len(text) <= _SHORT and opened <= _OPENED and not any(mark in text for mark in "*?\t"):
        with suppress(yaml.YAMLError):  # what is wrong with it is said below
            content = yaml.load(text, _InC)  # noqa: S506
            if _levels(content) < _NESTING:
                return content
    try:
        return yaml.load(text, _Loader)  # noqa: S506
    except yaml.YAMLError as error:
        raise ConfigError(one_line(error, name)) from None
    except RecursionError:
        raise ConfigError(f"{name}: is nested more deeply than {_NESTING} levels") from None


def _levels(content: Any) -> int:
    """How deeply lists and mappings are nested."""
    inner = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
    return 1 + max(map(_levels, inner), default=0)


def one_line(error: yaml.YAMLError, name: str) -> str:
    """`name:line: what is wrong` of an error in YAML."""
    mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
    line = f":{mark.line + 1}" if mark is not None else ""
    problem = getattr(error, "problem", None) or str(error).splitlines()[0]
    if "python/" in problem:
        problem = "asks for a Python object; only plain values are allowed"
    if "\\t" in problem:
        problem += " (indent with spaces, not tabs)"
    return f"{name}{line}: {problem}"
