"""`python -m rhs break KEY=LOW..HIGH [key=value ...]`: at which level of a setting do half of the runs fail?

    python -m rhs break sensor.image_sigma=0..60 world=square_small odometry=procrustes,keyframe
    python -m rhs break planner.iterations=10..10000 task=planning world=map1 planner=rrt_connect --runs 60
        --runs N        runs for each combination (40)
        --jobs N        processes at a time (one per core)
        --timeout S     a run that takes longer has failed (3600)

Levels are chosen where the next outcome tells most (Kontsevich and Tyler 1999); every run has a seed of its own, the same
for all combinations. Where success fades slowly along the dial 40 runs are too few; how many it takes is said. Killed, the
same command goes on in the folder that output=FOLDER names. Files in the folder: the runs, break.json,
break.png. Exit code 0, or 2 refused.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .arguments import JOBS, TIMEOUT, Number, going_on, limits, parse
from .say import of_searches


def main(words: Sequence[str]) -> int:
    """The command."""
    from rhs.sweeps import break_point

    chosen = parse("break", __doc__, words, runs=Number(40, low=4, high=10_000), jobs=JOBS, timeout=TIMEOUT)
    plan = break_point.plan(chosen.typed)
    within = limits(chosen)
    with going_on(plan.output) as folder:
        accounts = _searched(plan, folder, within, chosen.runs)
        _publish(accounts, plan.dial, folder)
        sys.stdout.write(f"{of_searches(accounts, list(map(count, accounts)))}files: {folder}\n")
    return 0


def count(account: dict[str, Any]) -> str:
    """How many runs; and how many it takes to know the level within a twentieth of the dial, where these are too few."""
    runs, needed = account["runs"], account["runs_needed"]
    more = account["found"] and needed > runs
    return f"{runs} runs" + (f"; within 5 % of the dial takes about --runs {math.ceil(needed / 10) * 10}" if more else "")


def _searched(plan: Any, folder: Path, limits: Any, runs: int) -> list[dict[str, Any]]:
    """The search under one progress bar."""
    from rhs.metrics.threshold import in_words
    from rhs.sweeps import break_point

    from .progress import running

    def found() -> str:
        return in_words(plan.searches[0].known.summary(), plan.dial)

    with running(runs * len(plan.searches), unit="run", found=found) as tell:
        return break_point.run_plan(plan, folder, limits, runs=runs, tell=tell)


def _publish(accounts: list[dict[str, Any]], dial: Any, folder: Path) -> None:
    """break.json and break.png."""
    from rhs.reports.dial_pictures import threshold_picture
    from rhs.reports.export import write_text

    write_text(folder / "break.json", json.dumps(accounts, indent=1) + "\n")
    threshold_picture(accounts, dial, folder / "break.png")
