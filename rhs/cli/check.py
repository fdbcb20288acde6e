"""`python -m rhs check KIND=NAME [KIND.KEY=VALUE ...]`: does a plugin keep its contract?

Every check of rhs.testing for that kind, one line each. Exit code 0 when all hold, 1 when one does not, 2 refused.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import Any

from rhs.card.card import contract
from rhs.testing.checks import SHOWN

from .card import part_of


def main(words: Sequence[str]) -> int:
    """The command."""
    kind, name, chosen = part_of(words, "check")
    before: dict[str, str] = {}
    clock = [time.perf_counter()]

    def tell(one: dict[str, Any]) -> None:
        why, began = one["why"], clock.pop()
        clock.append(time.perf_counter())
        reason = f"as before ({before[why]})" if before.get(why) else why
        before.setdefault(why, one["check"])
        sys.stdout.write(f"{'ok   ' if one['holds'] else 'FAILS'}{clock[0] - began:7.1f} s  {one['check']}"
                         f"{f': {reason}' if why else ''}\n")
        sys.stdout.flush()

    failed = sum(not one["holds"] for one in contract(kind, chosen, tell))
    if failed and (lacking := sorted(set(chosen.needs) - SHOWN)):  # type: ignore[attr-defined]
        sys.stdout.write(f"the views of these checks hold no {', '.join(lacking)}, which it needs: what fails by that is no "
                         "fault; try it in a run\n")
    sys.stdout.write(f"{kind}={name}: {f'{failed} checks fail' if failed else 'keeps its contract'}\n")
    return 1 if failed else 0
