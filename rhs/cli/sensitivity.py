"""`python -m rhs sensitivity KIND=NAME [key=value ...]`: which settings of a part matter?

    python -m rhs sensitivity odometry=procrustes
    python -m rhs --plugin my.py sensitivity odometry=mine world=office,home --only gate,advanced.window
        --only KEY,...     of the part's settings only those whose keys begin so
        --recording "PATH source.camera=tum_fr1"      a recording in addition, with words of its own; several times: several
        --data FOLDER      in addition those with colour and depth of `bench recordings-v1`
        --jobs N           processes at a time (one per core)
        --timeout S        a run that takes longer has failed (3600)
        output=FOLDER      where it goes (results/sweeps/sensitivity_KIND_NAME)

Every number of the part, those under `advanced` too, is halved and doubled, in five drawn buildings (planners: on four maps
with three seeds), paired with the same runs as they are. Odometries are measured by the error of the survey before closing,
loop closers after it, mappers by the map's disagreement, localisers by the error of the belief in a patrol, planners by the
length of the path. `worse`, `better`: the 95 % interval over buildings leaves out all up to 2 %; `fails`: fewer runs
succeed than chance has it (Boschloo's test, 5 %; of five that all succeed three are lost). Killed, the same command goes on.
Files: sensitivity.csv, .json, .png. Exit code 0, or 2 refused.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.base.commands import aligned

from .arguments import JOBS, TIMEOUT, going_on, limits, parse

if TYPE_CHECKING:
    from rhs.sweeps.sensitivity import Effect, Question

HOME = Path("results") / "sweeps"
COLUMNS = ("setting", "default", "value", "change_pct", "low_pct", "high_pct", "pairs", "lost", "won", "says")


def main(words: Sequence[str]) -> int:
    """The command."""
    from rhs.sweeps.kept import broken_off, kept_rows
    from rhs.sweeps.sensitivity import ask, check_recorded, effects, frozen, in_words, recording

    from .progress import running

    chosen = parse("sensitivity", __doc__, words, only="", recording=(), data="", jobs=JOBS, timeout=TIMEOUT)
    recordings = [*map(recording, chosen.recording), *(frozen(Path(chosen.data), chosen.words) if chosen.data else ())]
    asked = ask(chosen.words, only=[key for key in chosen.only.split(",") if key], recordings=recordings)
    within = limits(chosen)
    with going_on(chosen.output or str(HOME / f"sensitivity_{asked.part.replace('=', '_')}")) as folder:
        if asked.recorded:
            check_recorded(kept_rows(asked.recorded, folder, within, tell=lambda job, status: None, keep="none"))
        with running(len(asked.jobs)) as tell:
            rows = kept_rows(asked.jobs, folder, within, tell=tell, keep="none")
        found = effects(asked, rows)
        _publish(asked, found, folder)
        as_it_is = broken_off(rows[:len(asked.pairs)])
        said = [*in_words(found, asked), *([f"runs as it is: {as_it_is}"] if as_it_is else [])]
        sys.stdout.write("\n".join([*table(found), "", *said, f"files: {folder}", ""]))
    return 3 if as_it_is else 0


def cells(one: Effect) -> list[str]:
    """A change as it stands in the table."""
    shares = ["" if math.isnan(value) else f"{100 * value:.4g}" for value in (one.change, one.low, one.high)]
    counts = [str(count) for count in (one.pairs, one.lost, one.won)]
    return [one.of.key, f"{one.of.before:g}", f"{one.of.value:g}", *shares, *counts, one.says]


def table(found: Sequence[Effect]) -> list[str]:
    """Lines, the largest effects first; those that change nothing are left to a sentence."""
    return aligned([list(COLUMNS), *(cells(one) for one in found if not one.same)])


def _publish(asked: Question, found: Sequence[Effect], folder: Path) -> None:
    """sensitivity.csv, sensitivity.json, sensitivity.png."""
    from rhs.reports.export import without_nan, write_texts
    from rhs.reports.sensitivity_picture import sensitivity_picture
    from rhs.sweeps.sensitivity import LACKS

    changes: list[dict[str, Any]] = [
        {"key": one.of.key, "default": one.of.before, "value": one.of.value, "factor": one.of.factor,
         **without_nan({"change": one.change, "low": one.low, "high": one.high}), "pairs": one.pairs, "lost": one.lost,
         "won": one.won, "same": one.same, "says": one.says} for one in found]
    content = {"part": asked.part, "measure": asked.measure, "worlds": [world for world, _ in asked.pairs],
               "effects": changes, "left_out": dict(asked.left_out)}
    lines = [",".join(row) for row in [list(COLUMNS), *map(cells, found)]]
    write_texts(folder, {"sensitivity.json": json.dumps(content, indent=1) + "\n",
                         "sensitivity.csv": "\n".join([*lines, ""])})
    moved = [one for one in changes if not one["same"]]
    measure = f"what {asked.measure} lacks of 1" if asked.measure in LACKS else asked.measure
    title = f"{asked.part}: {measure}, new over old, {len(asked.pairs)} pairs (less is better)"
    sensitivity_picture(moved or changes, title, folder / "sensitivity.png")
