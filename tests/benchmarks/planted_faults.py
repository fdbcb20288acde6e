"""One fault planted in a known link: does `task=blame` name that link?

    python tests/benchmarks/planted_faults.py --seeds 0-1 --worlds square_small --out runs/planted
    python tests/benchmarks/planted_faults.py --links map plan --worlds square_small random:office/3

Faults: sense (noise of image and depth), odometry (turns too far), map (walls that are not there), localise (turns with
every view), plan (finds no way to what is far). A run is 32 patrols: every combination of these links given the truth.
`named`: the link that blame names; a run that the fault cost nothing, so that nobody is named, is not counted.
Killed, the same command goes on. Writes planted_faults.csv beside the runs.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import planted
from shared import write

from rhs.base.provenance import commit
from rhs.config.compose import Composer
from rhs.config.overrides import parse, plain_words
from rhs.sweeps.jobs import Job, Limits
from rhs.sweeps.kept import Row, kept_rows
from rhs.sweeps.sweep import job_of

LINKS = ("sense", "odometry", "map", "localise", "plan")
FAULTS = {"sense": "sensor.image_sigma=60 sensor.depth_quadratic_per_m=0.05", "odometry": "odometry=crooked gate.act=off",
          "map": "mapper=walled", "localise": "localiser=drunk", "plan": "planner=faint"}
COMMON = ("task=blame", f"links=[{','.join(LINKS)}]", "source.image_width=160", "recording=off", "pictures=off",
          "planner=astar")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", nargs="+", default=list(LINKS), choices=LINKS)
    parser.add_argument("--worlds", nargs="+", default=["square_small"])
    parser.add_argument("--seeds", default="0-0", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/planted"))
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    cases = [(link, world, seed) for world in options.worlds for seed in range(int(first), int(last or first) + 1)
             for link in options.links]
    options.out.mkdir(parents=True, exist_ok=True)
    jobs = [job(*case, options.processes) for case in cases]
    rows = kept_rows(jobs, options.out, Limits(1), tell=lambda job, status: sys.stderr.write(f"{job.name}: {status}\n"))
    found = [line(case, row) for case, row in zip(cases, rows, strict=True)]
    write(options.out / "planted_faults.csv", found)
    counted = [one for one in found if one["counts"]]
    right = sum(one["named"] == one["planted"] for one in counted)
    for one in found:
        named = one["named"] or "-"
        sys.stdout.write(f"{one['planted']:<9} {one['world']:<20} {one['seed']:>3}  named {named:<9} {one['blame']}\n")
    rest = len(found) - len(counted)
    sys.stdout.write(f"right link named in {right} of {len(counted)} ({rest} cost nothing or left no row)\n")
    sys.stdout.write(f"commit: {commit()}\n")
    return 0


def job(link: str, world: str, seed: int, processes: int) -> Job:
    """The run of a case."""
    fault = FAULTS[link].split()
    chosen = {word.partition("=")[0] for word in fault}
    common = [word for word in COMMON if word.partition("=")[0] not in chosen]
    words = plain_words(parse([*common, *fault, f"processes={processes}", f"world={world}", f"seed={seed}"]))
    return job_of(Composer(()).config(words), words, [*chosen, "world", "seed"])


def line(case: tuple[str, str, int], row: Row) -> dict[str, Any]:
    """A case as a row of the table."""
    link, world, seed = case
    shares = {one: float(row.get(f"blame_places_{one}") or 0.0) for one in LINKS}
    return {"planted": link, "world": world, "seed": seed, "status": row["status"], "named": row.get("blame_link") or "",
            "counts": bool(row["status"] == "ok" and row.get("blame_link")), "visited": row.get("places_visited"),
            "places": row.get("places_total"), **shares, "blame": row.get("blame") or row.get("reason") or ""}


if __name__ == "__main__":
    assert planted.PARTS
    sys.exit(main())
