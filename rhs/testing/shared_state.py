"""Does a part leave alone what it shares with others: global generators and the arrays it was given? (rhs.testing)"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from rhs.base.global_generators import global_states

UNUSUAL = 2718281828  # a seed that nobody else takes: who seeds with 0 where it was 0 before would leave all as it was


@contextmanager
def untouched(*given: Any) -> Iterator[None]:
    """AssertionError if, meanwhile, a global generator of Python or numpy was used or seeded, or an array in `given`
    (records, sequences, arrays) was written to. Both generators are afterwards as they were."""
    states = random.getstate(), np.random.get_state()  # noqa: NPY002 - kept, never drawn from
    before = [(array, array.copy()) for value in given for array in _arrays(value)]
    random.seed(UNUSUAL)
    np.random.seed(UNUSUAL)  # noqa: NPY002 - so that every use shows
    seeded = global_states()
    try:
        yield
        for whose, state in global_states().items():
            assert state == seeded[whose], f"it used {whose}'s global generator; draw from context.rng only"
    finally:
        random.setstate(states[0])
        np.random.set_state(states[1])  # noqa: NPY002
    for array, copy in before:
        assert same(array, copy), f"it wrote to an array it was given, of shape {array.shape}"


def same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    """Whether both are nothing, or arrays that hold the same; NaN is NaN."""
    if a is None or b is None:
        return a is b
    return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def _arrays(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for item in value:
            yield from _arrays(item)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            yield from _arrays(getattr(value, name))
