"""What the validators of records share: one field at a time, frozen copies, and complaints in one line."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NoReturn, ParamSpec, TypeVar

import numpy as np

from rhs.base.errors import told

from .errors import ContractError
from .frozen import freeze, owned
from .records import BeliefStatus, PlanReason, Tracking, Twist

MOST_REASON = 2000  # characters
MOST_DETAILS = 1000  # numbers of one step
_NUMBER = (int, float, np.integer, np.floating, np.bool_)
Record = TypeVar("Record")
_Given = ParamSpec("_Given")


def _named(check: Callable[_Given, Record]) -> Callable[_Given, Record]:
    """The check of a record; what cannot be read at all (None for numbers, a class with another constructor) is its part's
    breach of contract too, and named as such."""
    @functools.wraps(check)
    def named(*given: _Given.args, **more: _Given.kwargs) -> Record:
        try:
            return check(*given, **more)
        except ContractError:
            raise
        except Exception as error:
            said = f"{more['who']}: what it returned cannot be read: {told(error)}"
            raise ContractError(said[:MOST_REASON]) from error

    return named


def _refuse(who: str, field: str, found: str, expected: str) -> NoReturn:
    raise ContractError(" ".join(f"{who}: {field} is {found}; expected {expected}".split()))


def _record(value: Any, kind: type[Record], who: str) -> Record:
    if not isinstance(value, kind):
        _refuse(who, "what it returned", f"of type {type(value).__name__}",
                f"{'an' if kind.__name__[0] in 'AO' else 'a'} {kind.__name__}")
    return value


def _member(value: Any, words: type[Tracking] | type[BeliefStatus] | type[PlanReason], who: str, field: str) -> None:
    if not isinstance(value, words):
        _refuse(who, field, repr(value)[:60], f"a {words.__name__}: {', '.join(words)}")


def _number(value: Any) -> bool:
    return isinstance(value, _NUMBER)


def _flag(value: Any, who: str, field: str) -> None:
    if not isinstance(value, bool | np.bool_):
        _refuse(who, field, _short(value), "True or False")


def _text(value: Any, who: str, field: str) -> None:
    if not isinstance(value, str) or len(value) > MOST_REASON:
        found = f"{len(value)} characters" if isinstance(value, str) else f"of type {type(value).__name__}"
        _refuse(who, field, found, f"a text of at most {MOST_REASON} characters")
    value.encode()  # half a character, which no file holds, is none


def _details(details: Any, who: str, own: tuple[str, ...] = ()) -> None:
    """own: names that steps.csv has for what the record itself says; a detail of that name would stand in its place."""
    if not isinstance(details, Mapping) or len(details) > MOST_DETAILS:
        _refuse(who, "details", f"of type {type(details).__name__}", f"a mapping of at most {MOST_DETAILS} numbers by name")
    for name, value in details.items():
        if not isinstance(name, str) or not isinstance(value, _NUMBER):
            _refuse(who, f"details[{repr(name)[:60]}]", repr(value)[:60], "a number by a name")
        name.encode(), float(value)  # neither half a character nor a whole number beyond all floats
        if name in own:
            _refuse(who, f"details[{name!r}]", repr(value)[:60], f"another name: the record's own {name} stands there")


def _array(value: Any, who: str, field: str, shape: tuple[int | None, ...], *, finite: bool = True, most: int | None = None,
           dtype: type | None = np.float64) -> np.ndarray:
    """A read-only copy of real numbers of this shape (None: any length)."""
    array = _known_of(value) if isinstance(value, np.ndarray) else _listed(value)
    array = np.empty([count or 0 for count in shape]) if array.shape == (0,) and shape[0] is None else array  # nothing
    if array.dtype.kind not in "fiu" or (array.shape != shape and not _fits(array.shape, shape)):
        found = (f"of shape {array.shape} and type {array.dtype}" if isinstance(value, np.ndarray) else
                 _short(value) if isinstance(value, list | tuple | str | int | float | None) else
                 f"of type {type(value).__module__}.{type(value).__name__}")
        _refuse(who, field, found, f"{_wanted(shape, finite)} in an array, a list or a tuple")
    if most is not None and len(array) > most:
        _refuse(who, field, f"{len(array)} long", f"at most {most}")
    if finite and not np.isfinite(array).all():
        _refuse(who, field, f"not finite: {_short(array)}", _wanted(shape, finite))
    copy = np.array(array, dtype)
    copy.setflags(write=False)
    return copy


_directions: dict[int, np.ndarray] = {}


def _known(bearings: np.ndarray) -> np.ndarray:
    """The same read-only (N,) bearings, of which all scans in a row share one copy: a sensor's beams seldom change."""
    before = _directions.get(len(bearings))
    if before is None or not np.array_equal(before, bearings):
        _directions[len(bearings)] = before = bearings
    return before


def _known_of(array: np.ndarray) -> np.ndarray:
    """The array; NaN, unknown, for what a masked one hides."""
    if not isinstance(array, np.ma.MaskedArray) or not array.mask.any():
        return array
    known: np.ndarray = np.ma.filled(array.astype(np.float64), np.nan)
    return known


def _listed(value: Any) -> np.ndarray:
    """Numbers written as a list or tuple; of type object when they are none."""
    try:
        return np.asarray(value) if isinstance(value, list | tuple) else np.empty((), object)
    except ValueError:  # rows of different lengths
        return np.empty((), object)


def _wanted(shape: tuple[int | None, ...], finite: bool) -> str:
    return f"{'finite ' * finite}{'x'.join('N' if n is None else str(n) for n in shape)} numbers"


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(shape) == len(wanted) and all(n in (None, have) for n, have in zip(wanted, shape, strict=True))


def _extras(extras: Any, who: str) -> Mapping[str, np.ndarray]:
    """The extra modalities, frozen; nobody fills them again."""
    if not isinstance(extras, Mapping):
        _refuse(who, "extras", f"of type {type(extras).__name__}", "a mapping of arrays by name")
    for name, value in extras.items():
        if not isinstance(name, str) or not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            _refuse(who, f"extras[{repr(name)[:60]}]", _short(value), "an array of numbers by a name")
    return freeze({name: owned(value) for name, value in extras.items()})


def _images(image: Any, depth: Any, size: tuple[int, int] | None, who: str) -> tuple[Any, Any]:
    """Shapes and types; both, frozen. What the pixels say costs too much to look at in every view."""
    image, depth = owned(image), owned(depth)
    if image is not None:
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            _refuse(who, "image", f"of shape {np.shape(image)} and type {getattr(image, 'dtype', type(image).__name__)}",
                    "(H, W, 3) uint8 RGB")
        size = _same(freeze(image).shape, size, who, "image")
    if depth is not None:
        if not isinstance(depth, np.ndarray) or depth.dtype.kind != "f" or depth.ndim != 2:
            _refuse(who, "depth", f"of shape {np.shape(depth)} and type {getattr(depth, 'dtype', type(depth).__name__)}",
                    "(H, W) float32 metres")
        _same(freeze(depth).shape, size, who, "depth")
    return image, depth


def _same(shape: tuple[int, ...], size: tuple[int, int] | None, who: str, field: str) -> tuple[int, int]:
    if size is not None and shape[:2] != size:
        _refuse(who, field, f"{shape[1]} x {shape[0]} pixels", f"{size[1]} x {size[0]}")
    return shape[0], shape[1]


def _contact(contact: Any, who: str) -> None:
    if contact is not None and not isinstance(contact, bool | np.bool_):
        _refuse(who, "contact", _short(contact), "True, False, or None of a robot without a bumper")


def _command(command: Twist | None, who: str) -> None:
    if command is None:
        return
    values = (command.forward_mps, command.turn_radps, command.duration_s) if isinstance(command, Twist) else (None,)
    if not all(_number(v) and math.isfinite(v) for v in values):
        _refuse(who, "command", _short(values), "a Twist of finite numbers, or None")


def _det(rotation: np.ndarray) -> float:
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()  # ten times as fast as numpy's for so small a matrix
    return float(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def _short(value: Any) -> str:
    """A value in few characters on one line."""
    text = (np.array2string(value.ravel(), precision=6, threshold=8, edgeitems=3) if isinstance(value, np.ndarray)
            else repr(value))
    return " ".join(text.split())[:100]
