"""A second processor that a run may use: two pieces of work at once, with the numbers of one after the other.

Off unless a run says so, as a single run does on a machine with two processors (`ahead=`); never in the jobs of a sweep. The
threads live as long as it is granted: beginning one for every piece costs more than the smaller pieces.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import TypeVar

MOST = 8  # pieces of work under way at once; a piece may wait for one that was begun before it
_First = TypeVar("_First")
_Second = TypeVar("_Second")
_spare: ThreadPoolExecutor | None = None


def grant(granted: bool) -> None:
    """Whether from now on there is a processor to spare, for the whole process. Waits for what is under way."""
    global _spare
    if granted == (_spare is not None):
        return
    ended, _spare = _spare, ThreadPoolExecutor(MOST, "spare") if granted else None
    if ended is not None:
        ended.shutdown()


def granted() -> bool:
    """Whether there is a processor to spare."""
    return _spare is not None


def _forked() -> None:
    """A process that this one forks has none of its threads."""
    global _spare
    _spare = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)


def later(call: Callable[[], _First]) -> Callable[[], _First]:
    """What gives the value of a call that is made at the same time as what follows where a processor is to spare, else at
    once. Raises then what the call raised. Worth it from half a millisecond of work without the interpreter's lock."""
    if _spare is None:
        value = call()
        return lambda: value
    return _spare.submit(call).result


def both(first: Callable[[], _First], second: Callable[[], _Second]) -> tuple[_First, _Second]:
    """What two functions return that do not depend on one another; at the same time where a processor is to spare. Worth
    it from half a millisecond of work without the interpreter's lock. Raises what `first` raised, else what `second` did."""
    if _spare is None:
        return first(), second()
    beside = _spare.submit(second)
    try:
        value = first()
    except BaseException:
        with suppress(BaseException):
            beside.result()
        raise
    if beside.cancel():  # nobody had time for it yet
        return value, second()
    return value, beside.result()
