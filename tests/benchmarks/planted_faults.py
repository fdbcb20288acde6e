"""One fault planted in a known link: does `task=blame` name that link?

    python tests/benchmarks/planted_faults.py --seeds 0-3 --out runs/planted
    python tests/benchmarks/planted_faults.py --links map plan --seeds 0-0 --worlds square_small

Five faults of each link (planted.py), seed k takes the k-th of them; a run is 32 patrols, every combination of these links
given the truth. Beside them each building and seed without a fault. A fault cost something where the run lost a place more
than that one, or 0.1 m more error of belief or of the survey, or 1 m more of the way; a run that lost nothing is counted
apart, whoever is named. Killed, the same command goes on. Writes planted_faults.csv beside the runs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import planted
from shared import write

from rhs.base.provenance import commit
from rhs.config.compose import Composer
from rhs.config.overrides import parse, plain_words
from rhs.metrics.blame import WORTH, judged, losses_of
from rhs.reports.intervals import share_text
from rhs.sweeps.jobs import Job, Limits
from rhs.sweeps.kept import Row, kept_rows
from rhs.sweeps.sweep import job_of

LINKS = tuple(planted.FAULTS)
WORLDS = ("random:office/18", "random:loop/32", "random:non_manhattan/10")
COMMON = ("source.image_width=160", "recording=off", "pictures=off", "planner=astar", "mission.views_max=60",
          "mission.lost_views=20", "mission.lost_views_total=40")
Case = tuple[str, str, int]  # link ("": none), world, seed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", nargs="+", default=list(LINKS), choices=LINKS)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--seeds", default="0-0", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/planted"))
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    cases = [(link, world, seed) for seed in range(int(first), int(last or first) + 1) for world in options.worlds
             for link in ("", *options.links)]
    options.out.mkdir(parents=True, exist_ok=True)
    jobs = [job(case, options.processes) for case in cases]
    rows = kept_rows(jobs, options.out, Limits(1), tell=lambda job, status: sys.stderr.write(f"{job.name}: {status}\n"))
    sound = {case[1:]: losses_of(row) for case, row in zip(cases, rows, strict=True) if not case[0]}
    found = [line(case, row, sound[case[1:]], options.out / job.name)
             for case, row, job in zip(cases, rows, jobs, strict=True) if case[0]]
    write(options.out / "planted_faults.csv", found)
    sys.stdout.write("\n".join([*table(found), f"commit: {commit()}", ""]))
    return 0


def fault_of(link: str, seed: int) -> str:
    """The fault of a link in runs with this seed."""
    names = list(planted.FAULTS[link])
    return names[seed % len(names)]


def job(case: Case, processes: int) -> Job:
    """The run of a case."""
    link, world, seed = case
    fault = planted.FAULTS[link][fault_of(link, seed)].split() if link else []
    chosen = {word.partition("=")[0] for word in fault}
    task = ["task=blame", f"links=[{','.join(LINKS)}]", f"processes={processes}"] if link else ["task=patrol"]
    common = [word for word in COMMON if word.partition("=")[0] not in chosen]
    words = plain_words(parse([*task, *common, *fault, f"world={world}", f"seed={seed}"]))
    return job_of(Composer(()).config(words), words, [*chosen, "task", "world", "seed"])


def line(case: Case, row: Row, sound: dict[str, float], folder: Path) -> dict[str, Any]:
    """A case as a row of the table; the verdict is that of today on the losses of the counterfactuals."""
    link, world, seed = case
    lost = losses_of(row)
    cost = [name for name, worth in WORTH.items() if lost[name] - sound[name] >= worth or lost[name] != lost[name]]
    told: dict[str, Any] = {"link": "", "verdict": row.get("reason") or ""}
    if row["status"] == "ok":
        known = json.loads((folder / "blame.json").read_text("utf-8"))
        losses = {name: {frozenset(() if links == "nothing" else links.split("+")): float("nan") if one[name] is None
                         else one[name] for links, one in known["losses"].items()} for name in WORTH}
        told = judged(losses, LINKS, since=known["off_since"])
    return {"planted": link, "fault": fault_of(link, seed), "world": world, "seed": seed, "status": row["status"],
            "cost": "+".join(cost), "named": told["link"], "right": int(told["link"] == link),
            "missed": lost["places"], "missed_without": sound["places"], "belief_m": lost["belief"],
            "belief_m_without": sound["belief"], "blame": told["verdict"]}


def table(found: Sequence[dict[str, Any]]) -> list[str]:
    """What was named, link by link, of the runs that their fault cost something."""
    lines = [f"{one['planted']:<9} {one['fault']:<9} {one['world']:<18} {one['seed']:>3}  cost {one['cost'] or '-':<22} "
             f"named {one['named'] or '-':<9} {one['blame']}" for one in found]
    lines += ["", "| planted | runs | cost something | cost places | named | no loss: nobody named |",
              "|---|---|---|---|---|---|"]
    for link in (*dict.fromkeys(one["planted"] for one in found), "all"):
        runs = [one for one in found if link in ("all", one["planted"])]
        cost = [one for one in runs if one["cost"] and one["status"] == "ok"]
        rest = [one for one in runs if not one["cost"]]
        places = [one for one in cost if "places" in one["cost"]]
        named = share_text([one["right"] for one in cost]) if cost else "-"
        nobody = f"{sum(not one['named'] for one in rest)} of {len(rest)}"
        lines.append(f"| {link} | {len(runs)} | {len(cost)} | {len(places)} | {named} | {nobody} |")
    return lines


if __name__ == "__main__":
    sys.exit(main())
