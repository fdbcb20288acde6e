"""A second processor that a run may use: two pieces of work at once, with the numbers of one after the other.

Off unless a run says so, as a single run does on a machine with two processors (`ahead=`); never in the jobs of a sweep. No
thread lives longer than the call it is for, so that a process may fork.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
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


def both(first: Callable[[], _First], second: Callable[[], _Second]) -> tuple[_First, _Second]:
    """What two functions return that do not depend on one another; at the same time where a processor is to spare. Worth
    it from half a millisecond of work without the interpreter's lock. Raises what `first` raised, else what `second` did."""
    if not _granted:
        return first(), second()
    made: list[_Second] = []
    failed: list[BaseException] = []

    def beside() -> None:
        try:
            made.append(second())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=beside, name="spare", daemon=True)
    thread.start()
    try:
        value = first()
    finally:
        thread.join()
    if failed:
        raise failed[0]
    return value, made[0]
