"""A progress bar around the steps of a run. It shows itself on a terminal and stays silent in a pipe (level 4)."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator

from rhs.api.records import Step


def bar(steps: Iterable[Step], phase: str, expected: int | None) -> Iterator[Step]:
    """The same steps; a bar with the phase, the place in it and the last event is drawn on stderr meanwhile."""
    from tqdm import tqdm

    with tqdm(total=expected, desc=f"{phase:<8}", unit="view", disable=None, file=sys.stderr, leave=True,
              dynamic_ncols=True, smoothing=0.1) as shown:
        for step in steps:
            shown.set_postfix_str(_note(step), refresh=False)
            shown.update()
            yield step


def _note(step: Step) -> str:
    words = [str(step.motion.status)] if str(step.motion.status) != "ok" else []
    if step.mission:
        words.append(f"mission {step.mission}")
    return " ".join([*words, step.event])
