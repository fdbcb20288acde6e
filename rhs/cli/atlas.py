"""`python -m rhs atlas FILE.yaml`: several dials over several combinations, where does each break?

    python -m rhs atlas conf/atlas/example.yaml
        --runs N        runs of each search (the file's, or 40)
        --jobs N        processes at a time (one per core)
        --timeout S     a run that takes longer has failed (3600)
        output=FOLDER   where it goes (results/sweeps/atlas_NAME)

The file names combinations of parts and dials, KEY=LOW..HIGH; each pair is searched as `python -m rhs break` does, all in
turn. Killed, the same command goes on; combinations and dials may be added. Files: atlas.png (rows: combinations, columns:
dials), atlas.csv, atlas.json, the folders of the runs that failed. Exit code 0, or 2 refused.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rhs.base.errors import ConfigError

from .arguments import JOBS, TIMEOUT, Number, going_on, limits, parse
from .say import of_searches

if TYPE_CHECKING:
    from rhs.sweeps.atlas import Atlas
    from rhs.sweeps.jobs import Limits

HOME = Path("results") / "sweeps"


def main(words: Sequence[str]) -> int:
    """The command."""
    from rhs.sweeps.atlas import read_atlas

    chosen = parse("atlas", __doc__, words, runs=Number(0, low=0, high=10_000), jobs=JOBS, timeout=TIMEOUT)
    if len(chosen.words) != 1:
        raise ConfigError("atlas: expected one file of combinations and dials: python -m rhs atlas conf/atlas/example.yaml")
    file = Path(chosen.words[0])
    atlas = read_atlas(file, chosen.runs)
    within = limits(chosen)
    with going_on(chosen.output or str(HOME / f"atlas_{file.stem}")) as folder:
        _searched(atlas, folder, within)
        sys.stdout.write(f"files: {folder}\n")
    return 0


def _searched(atlas: Atlas, folder: Path, limits: Limits) -> None:
    """The searches under one progress bar; what is known is published, also when interrupted."""
    from rhs.sweeps.atlas import run_atlas

    from .progress import running

    try:
        with running(atlas.runs * len(atlas.cells)) as tell:
            run_atlas(atlas, folder, limits, tell=tell)
    finally:
        _publish(atlas, folder)


def _publish(atlas: Atlas, folder: Path) -> None:
    """atlas.json, atlas.csv, atlas.png; a line for each search."""
    from rhs.reports.dial_pictures import atlas_picture
    from rhs.reports.export import write_texts
    from rhs.sweeps.atlas import accounts, csv_of

    if not (results := accounts(atlas)):
        return
    write_texts(folder, {"atlas.json": json.dumps(results, indent=1) + "\n", "atlas.csv": csv_of(results)})
    atlas_picture(results, folder / "atlas.png")
    sys.stdout.write(of_searches(results, [f"{one['runs']} runs" for one in results]))
