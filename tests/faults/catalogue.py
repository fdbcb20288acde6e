"""The list of faults: each has an id, a title, the answer that is expected, and a function that tries it through the command
line. The table in tests/README.md is `table()`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from faults.bench import Bench

Attempt = Callable[[Bench], None]


@dataclass(frozen=True)
class Fault:
    """id and title as in the shared list; not_tried: what of it no ordinary machine can try, and why."""

    id: str
    title: str
    expected: str
    attempt: Attempt
    slow: bool = False
    not_tried: str = ""


FAULTS: dict[str, Fault] = {}


def fault(id: str, title: str, expected: str, *, slow: bool = False, not_tried: str = "") -> Callable[[Attempt], Attempt]:
    """Decorator: the function tries this fault."""

    def enter(attempt: Attempt) -> Attempt:
        assert id not in FAULTS, f"{id} stands twice"
        FAULTS[id] = Fault(id, title, expected, attempt, slow, not_tried)
        return attempt

    return enter


ORDER = "CPSNLRWXE"  # config, plugin, sensor, numerics, planner, recording, sweep, security, environment


def in_order() -> list[Fault]:
    return sorted(FAULTS.values(), key=lambda one: (ORDER.index(one.id[0]), one.id))


def table() -> str:
    """The table of tests/README.md."""
    lines = ["| id | fault | expected answer | not tried here, and why |", "|---|---|---|---|"]
    return "\n".join([*lines, *(f"| {one.id} | {one.title} | {one.expected} | {one.not_tried} |" for one in in_order())])
