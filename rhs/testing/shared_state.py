"""Does a part leave alone what it shares with others: global generators and the arrays it was given? (rhs.testing)"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np


@contextmanager
def untouched(*given: Any) -> Iterator[None]:
    """AssertionError if, meanwhile, a global generator of Python or numpy was used or seeded, or an array in `given`
    (records, sequences, arrays) was written to."""
    python, shared = random.getstate(), _numpy_state()
    before = [(array, array.copy()) for value in given for array in _arrays(value)]
    yield
    assert _numpy_state() == shared, "it used numpy's global generator; draw from context.rng only"
    assert random.getstate() == python, "it used Python's global generator; draw from context.rng only"
    for array, copy in before:
        same = np.array_equal(array, copy, equal_nan=array.dtype.kind == "f")
        assert same, f"it wrote to an array it was given, of shape {array.shape}"


def _numpy_state() -> tuple[Any, ...]:
    state: Any = np.random.get_state()  # noqa: NPY002 - looked at, never drawn from
    return (state[1].tobytes(), *state[2:])


def _arrays(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for item in value:
            yield from _arrays(item)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            yield from _arrays(getattr(value, name))
