"""Plain values into settings dataclasses, strictly, with words for the user.

One converter for every path a value can take (YAML, command line, sweep, Python), so that all of them refuse the same
things in the same words. Nothing is converted except an int to a float.
"""

from __future__ import annotations

import dataclasses
import difflib
import enum
import functools
import json
import math
import re
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from rhs.base.errors import ConfigError, told, where, words_of
from rhs.base.errors import nearest as nearest

RESERVED = ("name", "defaults")  # rhs's own, and the word of Hydra's defaults lists


# the types of a class's fields, looked up once: a sweep makes the same classes for each of its jobs
_hints = functools.cache(typing.get_type_hints)


def make(cls: type, values: Mapping[str, Any], owner: str) -> Any:
    """An instance of the dataclass `cls` from plain values; `owner` is the dotted key they stand under ("" at the top).

    Raises ConfigError for an unknown key (naming the nearest), a wrong type, a missing value or a value out of range.
    """
    hints = _hints(cls)
    names = [f.name for f in dataclasses.fields(cls) if f.init]
    arguments = {}
    for key, value in values.items():
        if key not in names:
            raise unknown_key(owner, str(key), names)
        if dataclasses.is_dataclass(hints[key]) and isinstance(value, Mapping):
            value = _over(defaults(cls).get(key, {}), value)  # what is not said is as this class has it
        arguments[key] = _convert(hints[key], value, dotted(owner, key))
    try:
        made = cls(**arguments)
    except ConfigError as error:
        if owner and re.split(r"\W", str(error), maxsplit=1)[0] in names:  # a nested group knows its own names only
            raise ConfigError(f"{owner}.{error}") from error
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # of somebody's __post_init__, which may even exit
        said = words_of(error) if isinstance(error, TypeError | ValueError) else ""
        said = said or f"{cls.__name__} cannot be made: {told(error)}{where(error)}"
        raise ConfigError(f"{owner or cls.__name__}: {said}") from error
    for key, value in arguments.items():
        if not _is_finite(value) and repr(plain(value)) != repr(defaults(cls).get(key)):
            wanted = "a finite number" if isinstance(value, float) else "finite numbers"
            raise ConfigError(f"{dotted(owner, key)}={_show(value)}: expected {wanted}")
    return made


def _is_finite(value: Any) -> bool:
    """Whether a number, and every number in lists and dicts, is finite."""
    if isinstance(value, list | tuple):
        return all(map(_is_finite, value))
    if isinstance(value, Mapping):
        return all(map(_is_finite, value.values()))
    return not isinstance(value, float) or math.isfinite(value)


def _over(base: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` laid over `base`, group by group."""
    merged = dict(base)
    for key, value in values.items():
        below = merged.get(key)
        merged[key] = _over(below, value) if isinstance(below, Mapping) and isinstance(value, Mapping) else value
    return merged


def unknown_key(owner: str, key: str, known: list[str], also: Sequence[str] = ()) -> ConfigError:
    """The error for a key nobody knows. also: keys that are known elsewhere, and may have been meant."""
    hint = nearest(key, [*known, *also], owner)
    shown = ", ".join(sorted(known)[:12]) + (", ..." if len(known) > 12 else "")
    return ConfigError(f"unknown key {dotted(owner, key)}{hint or f'; there is {shown}'}")


def slip(word: str, known: Iterable[str]) -> str:
    """The known word that this one is, typed wrong, or nothing; `right_image` is a word of its own, no slip of `image`."""
    close = difflib.get_close_matches(word, sorted(known), n=1, cutoff=0.75) if word.isalpha() else []
    return close[0] if close else ""


def near_file(path: Path) -> str:
    """`; did you mean x?`, x the file or folder beside it whose name is most like that of one that does not exist."""
    try:
        return nearest(path.name, [entry.name for entry in path.parent.iterdir()]) if path.name else ""
    except OSError:
        return ""


def dotted(owner: str, key: str) -> str:
    """`owner.key`, or the key alone at the top."""
    return f"{owner}.{key}" if owner else str(key)


def defaults(cls: type) -> dict[str, Any]:
    """The plain default values of a settings dataclass, nested ones as dicts. Raises ConfigError if one has none."""
    out: dict[str, Any] = {}
    for item in dataclasses.fields(cls):
        if not item.init:
            continue
        if item.default is item.default_factory is dataclasses.MISSING:
            raise ConfigError(f"{cls.__module__}.{cls.__qualname__}.{item.name} has no default value; give it one")
        out[item.name] = plain(_default(item))
    return out


def is_dict(cls: type, path: Sequence[str]) -> bool:
    """Whether a path of names leads to a setting of type dict, or into one, whose keys are anybody's; or to one that may be
    a dataclass and is not yet (`Inner | None`), which looks at its keys when it is made."""
    hint = _hints(cls).get(path[0]) if path else None
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return is_dict(hint, path[1:])
    kinds = typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)
    return any((typing.get_origin(kind) or kind) is dict or dataclasses.is_dataclass(kind) for kind in kinds)


def is_record(value: Any) -> bool:
    """Whether this is an object of a dataclass."""
    return dataclasses.is_dataclass(value) and not isinstance(value, type)


def plain(value: Any) -> Any:
    """Dataclasses as dicts, tuples and arrays as lists, enumerations as their value (or name), paths as text: what can be
    written to YAML or JSON."""
    if is_record(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.init}
    if isinstance(value, Mapping):
        return {k.name if isinstance(k, enum.Enum) else str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, enum.Enum):
        return value.value if isinstance(value.value, (str, int, float)) else value.name
    if hasattr(value, "tolist"):  # arrays and numbers of NumPy, columns of pandas
        return plain(value.tolist())
    return str(value) if isinstance(value, PurePath) else value


def unusable(cls: type, owner: str = "") -> str:
    """Which setting of a dataclass nobody can type, or whose default is not of its type, in words; else nothing."""
    for item in (item for item in dataclasses.fields(cls) if item.init):
        hint, key = _hints(cls)[item.name], dotted(owner, item.name)
        if key in RESERVED:
            return f"setting {key} has a name that rhs uses itself; rename it"
        if not key.isascii():
            return f"setting {key} cannot be typed; name it by the letters a to z"
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            if said := unusable(hint, key):
                return said
        elif not _typable(hint):
            return (f"setting {key} of type {type_name(hint)} cannot be typed; use numbers, bool, str, Path, Enum, Literal, "
                    "list, tuple, dict, a dataclass")
        if item.default is item.default_factory is dataclasses.MISSING:
            return f"setting {key} has no default value; give it one"
        try:
            _convert(hint, plain(_default(item)), key)
            json.dumps(plain(_default(item)))  # Any takes a function, which no file holds
        except Exception as error:
            said = str(error) if isinstance(error, ConfigError) else told(error)
            return f"the default of setting {key} does not fit its type: {said}"
    return ""


def _default(item: dataclasses.Field[Any]) -> Any:
    return item.default if item.default_factory is dataclasses.MISSING else item.default_factory()


def _typable(hint: Any) -> bool:
    inner = [one for one in typing.get_args(hint) if one is not Ellipsis]
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType, list, tuple, dict):
        return all(map(_typable, inner))
    return (hint in (Any, float, int, str, bool, types.NoneType, list, tuple, dict) or origin is typing.Literal
            or dataclasses.is_dataclass(hint) or (isinstance(hint, type) and issubclass(hint, enum.Enum | PurePath)))


def type_name(hint: Any) -> str:
    """A type as a user reads it: `int`, `list[float]`, `str | None`."""
    if hint is type(None):
        return "null"
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return " | ".join(type_name(h) for h in typing.get_args(hint))
    if typing.get_origin(hint) is typing.Literal:
        return " | ".join(map(str, typing.get_args(hint)))
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        return " | ".join(str(plain(member)) for member in hint)
    if typing.get_origin(hint) is not None:
        return str(hint).replace("typing.", "")
    return getattr(hint, "__name__", str(hint))


def _convert(hint: Any, value: Any, key: str) -> Any:
    """`value` as the type `hint` asks for, or ConfigError."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value
    if origin in (typing.Union, types.UnionType):
        return _convert_union(inner, value, key, hint)
    if origin is typing.Literal:
        for one in inner:
            if one == value and type(one) is type(value):  # true is not 1
                return one
        raise _wrong(key, value, hint)
    if (origin or hint) in (list, tuple):
        return _convert_sequence(origin or hint, inner, value, key, hint)
    if origin is dict or hint is dict:
        if isinstance(value, Mapping):
            return {_key(inner[0] if inner else Any, k, key): _convert(inner[1] if inner else Any, v, dotted(key, k))
                    for k, v in value.items()}
        raise _wrong(key, value, hint)
    if dataclasses.is_dataclass(hint):
        if isinstance(value, Mapping):
            return make(typing.cast(type, hint), value, key)
        raise ConfigError(f"{key}={_show(value)}: {key} is a group of settings; write {key}.NAME=VALUE")
    return _convert_scalar(hint, value, key)


def _key(hint: Any, key: Any, owner: str) -> Any:
    """A key of a dict as its type asks for it; in YAML and on the command line all keys are text."""
    try:
        return _convert(hint, hint(key) if hint in (int, float) and isinstance(key, str) else key, owner)
    except ValueError as error:
        raise ConfigError(f"{owner}: the key {key!r}: expected {type_name(hint)}") from error


def _convert_scalar(hint: Any, value: Any, key: str) -> Any:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if hint is float and number:
        return float(value)
    if hint is int and number and not isinstance(value, float):
        return value
    if hint is bool and isinstance(value, bool):
        return value
    if hint is str and isinstance(value, str):
        return value
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        for member in hint:
            if value in (member, member.value, member.name):
                return member
    if isinstance(hint, type) and issubclass(hint, PurePath) and isinstance(value, (str, PurePath)):
        return hint(value)
    if hint is type(None) and value is None:
        return None
    if hint is str and number:
        raise ConfigError(f"{key}={_show(value)}: expected text, found a number; quote it: {key}=\\'{_show(value)}\\'")
    raise _wrong(key, value, hint)


def _convert_union(inner: tuple[Any, ...], value: Any, key: str, hint: Any) -> Any:
    for option in inner:
        try:
            return _convert(option, value, key)
        except ConfigError:
            continue
    raise _wrong(key, value, hint)


def _convert_sequence(origin: type, inner: tuple[Any, ...], value: Any, key: str, hint: Any) -> Any:
    if not isinstance(value, (list, tuple)):
        raise _wrong(key, value, hint)
    if origin is tuple and inner and inner[-1] is not Ellipsis:
        if len(value) != len(inner):
            raise ConfigError(f"{key}={_show(value)}: expected {len(inner)} values, got {len(value)}")
        kinds = list(inner)
    else:
        kinds = [inner[0] if inner else Any] * len(value)
    return origin(_convert(kind, v, f"{key}[{i}]") for i, (kind, v) in enumerate(zip(kinds, value, strict=True)))


def _wrong(key: str, value: Any, hint: Any) -> ConfigError:
    say = {bool: ": true or false", int: ", a whole number", float: ", a number"}.get(hint, "")
    return ConfigError(f"{key}={_show(value)}: expected {type_name(hint)}{say}")


def _show(value: Any) -> str:
    text = {True: "true", False: "false", None: "null"}[value] if value is None or value is True or value is False else (
        str(value))
    return text if len(text) <= 60 else text[:57] + "..."
