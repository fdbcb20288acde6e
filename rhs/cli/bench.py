"""`python -m rhs bench SET`: a frozen set of questions and a table that anyone makes again, byte for byte.

    python -m rhs bench planning-v1                                   every planner of ours
    python -m rhs bench planning-v1 --mine planner=x                  yours beside them (also with --plugin)
    python -m rhs bench planning-v1 --mine planner=prm planner.milestones=500
        --only                yours alone
        output=FOLDER         where the table goes (results/bench)
    python -m rhs bench corridor-v1                                   whole chains of ours in twelve buildings; home-v1 too
    python -m rhs bench corridor-v1 --mine odometry=x localiser=y     yours, beside the table that is checked in
        --ours NAME,NAME      of ours only these; --quick: one building of each family, no entry
        --jobs N              processes at a time (one per core); --timeout S: of one run (3600)
        --entry FOLDER        also what an entry needs: the rows, and the configurations that `rhs verify` runs again
        --blame               also which link it was, in the runs that lost something
        --held-out FILE       the buildings that were promised by a hash, once they are shown
        output=FOLDER         where the runs go (results/sweeps/NAME); killed, the same command goes on
    python -m rhs bench recordings-v1 --data FOLDER                   estimators on frozen recordings, known by their hash
        --mine sensor=laser odometry=x                                options as above; the folder: RHS_DATA, or data

planning-v1: 60 questions with three seeds each. Files: NAME.csv (a row for each answer or run, no time in it), NAME.md
(scores, hashes of rows, times); of buildings NAME_more.csv and .md too: idleness beside its bound, precision over visits,
blame. Where chains break: `python -m rhs atlas conf/atlas/corridor-v1.yaml`, which takes a night. Exit code 0; 1 when an
answer of yours is wrong; 2 refused; 3 when a run left no row.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rhs.base.errors import ConfigError
from rhs.config import registry

from .arguments import JOBS, TIMEOUT, parse
from .card import part_of, say

HOME = Path("results") / "bench"
SETS = ("planning-v1", "corridor-v1", "home-v1", "recordings-v1")


def main(words: Sequence[str]) -> int:
    """The command."""
    from rhs.base.provenance import commit
    from rhs.card import bench
    from rhs.card.forked import ForkResult, run_forked
    from rhs.reports.export import write_texts

    from .suite import shown

    chosen = parse("bench", __doc__, words, positional=["set"], mine="", only=False, quick=False, ours="", entry="",
                   held_out="", data="", blame=False, jobs=JOBS, timeout=TIMEOUT)
    if chosen.set not in SETS:
        raise ConfigError(f"bench {chosen.set}: there is {', '.join(SETS)}")
    if chosen.set != SETS[0]:
        from . import suite

        return suite.main(chosen, words)
    if chosen.quick or chosen.ours or chosen.entry or chosen.held_out or chosen.data or chosen.blame:
        raise ConfigError(f"bench {SETS[0]}: --quick, --ours, --entry, --held-out, --data and --blame are for "
                          f"{', '.join(SETS[1:])}")
    planners, folder = _planners(chosen, bench.PLANNERS)
    questions = bench.frozen_questions()
    if (digest := bench.digest(questions)) != bench.FROZEN:
        raise ConfigError(f"bench {chosen.set}: found questions {digest}, expected {bench.FROZEN}: its maps have changed")
    found: dict[str, ForkResult] = {}
    for name, settings in planners.items():
        say(name)
        found[name] = run_forked(partial(bench.work, name, settings, questions), patience_s=bench.PATIENCE_S)
    say("")
    command = shown(words)
    page = bench.page(found, len(questions) * len(bench.SEEDS), command=command, made_at=commit() or "unknown")
    table = bench.csv_of([row for result in found.values() for row in result.items])
    write_texts(folder, {f"{SETS[0]}.md": page, f"{SETS[0]}.csv": table})
    sys.stdout.write(f"{page}\nfiles: {folder}\n")
    mine = found.get(next(reversed(planners))) if chosen.mine else None
    return int(mine is not None and (bool(mine.ended) or any(row["fault"] for row in mine.items)))


def _planners(chosen: argparse.Namespace, ours: Sequence[str]) -> tuple[dict[str, Any], Path]:
    """Name -> settings, mine last; the folder. Raises ConfigError."""
    words, folder = chosen.words, Path(chosen.output) if chosen.output else HOME
    if words and not chosen.mine or chosen.only and not chosen.mine:
        raise ConfigError(f"bench: {'--only' if chosen.only else words[0]}: say whose: --mine planner=NAME")
    planners = {} if chosen.only else {name: registry.load("planner", name)() for name in ours
                                       if registry.failure("planner", name) is None}
    if chosen.mine:
        kind, name, settings = part_of([chosen.mine, *words], "bench")
        if kind != "planner":
            raise ConfigError(f"bench {SETS[0]} --mine {chosen.mine}: expected planner=NAME")
        title = " ".join([name, *words])
        planners.pop(title, None)
        planners[title] = settings
    return planners, folder
