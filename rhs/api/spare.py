"""A second processor that a run may use: two pieces of work at once, with the numbers of one after the other.

Off unless a run says so, as a single run does on a machine with two processors (`ahead=`); never in the jobs of a sweep. No
thread outlives the work it is for, so that a process may fork.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

_First = TypeVar("_First")
_Second = TypeVar("_Second")
_granted = False


def grant(granted: bool) -> None:
    """Whether from now on there is a processor to spare, for the whole process."""
    global _granted
    _granted = granted


def granted() -> bool:
    """Whether there is a processor to spare."""
    return _granted


def later(call: Callable[[], _First]) -> Callable[[], _First]:
    """What gives the value of a call that is made at the same time as what follows where a processor is to spare, else at
    once. Raises then what the call raised. Worth it from half a millisecond of work without the interpreter's lock."""
    if not _granted:
        value = call()
        return lambda: value
    made: list[_First] = []
    failed: list[BaseException] = []

    def beside() -> None:
        try:
            made.append(call())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=beside, name="spare", daemon=True)
    thread.start()

    def settled() -> _First:
        thread.join()
        if failed:
            raise failed[0]
        return made[0]

    return settled


def both(first: Callable[[], _First], second: Callable[[], _Second]) -> tuple[_First, _Second]:
    """What two functions return that do not depend on one another; at the same time where a processor is to spare. Worth
    it from half a millisecond of work without the interpreter's lock. Raises what `first` raised, else what `second` did."""
    if not _granted:
        return first(), second()
    beside = later(second)
    try:
        value = first()
    except BaseException:
        with suppress(BaseException):
            beside()
        raise
    return value, beside()
