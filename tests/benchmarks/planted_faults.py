"""One fault planted in a known link: does `task=blame` name that link?

    python tests/benchmarks/planted_faults.py --seeds 0-3 --out runs/planted
    python tests/benchmarks/planted_faults.py --links map plan --seeds 0-0 --worlds square_small

Five faults of each link (planted.py), seed k takes the k-th of them; of the 32 combinations of these links given the truth
as many are driven as the shares need. Beside them each building and seed without a fault. A fault cost something where the
run lost a place more than that one, or 0.1 m more error of belief or of the survey, or 1 m more of the way; a run that lost
nothing is counted apart, whoever is named. planted_faults.csv beside the runs grows with each of them; killed, the same
command goes on. All 300: `--seeds 0-19`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import planted
from shared import write

from rhs.base.provenance import commit
from rhs.config.compose import Composer
from rhs.config.overrides import parse, plain_words
from rhs.metrics.blame import WORTH, losses_of, named_link
from rhs.reports.intervals import share_text
from rhs.sweeps.jobs import Job, Limits
from rhs.sweeps.kept import Row, any_row, kept_rows
from rhs.sweeps.sweep import job_of
from rhs.sweeps.worker import COMPILING

LINKS = tuple(planted.FAULTS)
WORLDS = ("random:office/18", "random:loop/32", "random:non_manhattan/10")
COMMON = ("odometry=procrustes", "recording=off", "pictures=off", "planner=astar", "mission.views_max=60",
          "mission.lost_views=20", "mission.lost_views_total=40")
Case = tuple[str, str, int]  # link ("": none), world, seed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", nargs="+", default=list(LINKS), choices=LINKS)
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS))
    parser.add_argument("--seeds", default="0-0", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/planted"))
    parser.add_argument("--width", type=int, default=160, help="of the views, pixels")
    parser.add_argument("--exact", action="store_true", help="drive all 32 patrols of a case, not as many as it takes")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    cases = [(link, world, seed) for seed in range(int(first), int(last or first) + 1) for world in options.worlds
             for link in ("", *options.links)]
    options.out.mkdir(parents=True, exist_ok=True)
    jobs = {case: job(case, options) for case in cases}

    def tell(job: Job, status: str) -> None:
        sys.stderr.write(f"{job.name}: {status}\n")
        if status != COMPILING:
            write(options.out / "planted_faults.csv", so_far(jobs, options.out))

    kept_rows(list(jobs.values()), options.out, Limits(1), tell=tell)
    sys.stdout.write("\n".join([*table(so_far(jobs, options.out)), f"commit: {commit()}", ""]))
    return 0


def so_far(jobs: Mapping[Case, Job], folder: Path) -> list[dict[str, Any]]:
    """The cases that have ended, those without a fault too, as rows of the table."""
    rows = {case: any_row(folder / job.name) for case, job in jobs.items() if (folder / job.name / "row.json").is_file()}
    return [line(case, row, losses_of(rows["", *case[1:]]), named(folder / jobs[case].name)) for case, row in rows.items()
            if case[0] and ("", *case[1:]) in rows]


def named(folder: Path) -> str:
    """Who is named for the losses of a run, by the rule as it is now; nobody where nothing worth a verdict was lost."""
    file = folder / "blame.json"
    blame = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    if not blame.get("measure"):
        return ""
    losses = {measure: {frozenset[str]() if name == "nothing" else frozenset(name.split("+")): one[measure]
                        for name, one in blame["losses"].items() if one[measure] is not None} for measure in WORTH}
    return named_link(blame["shares"][blame["measure"]], losses, blame["measure"])


def fault_of(link: str, seed: int) -> str:
    """The fault of a link in runs with this seed."""
    names = list(planted.FAULTS[link])
    return names[seed % len(names)]


def job(case: Case, options: argparse.Namespace) -> Job:
    """The run of a case."""
    link, world, seed = case
    fault = planted.FAULTS[link][fault_of(link, seed)].split() if link else []
    chosen = {word.partition("=")[0] for word in fault}
    asked = [f"links=[{','.join(LINKS)}]", f"processes={options.processes}", f"exact={str(options.exact).lower()}"]
    task = ["task=blame", *asked] if link else ["task=patrol"]
    common = [word for word in (f"source.image_width={options.width}", *COMMON) if word.partition("=")[0] not in chosen]
    words = plain_words(parse([*task, *common, *fault, f"world={world}", f"seed={seed}"]))
    return job_of(Composer(()).config(words), words, [*chosen, "task", "world", "seed"])


def line(case: Case, row: Row, sound: dict[str, float], named: str) -> dict[str, Any]:
    """A case as a row of the table."""
    link, world, seed = case
    lost = losses_of(row)
    cost = [name for name, worth in WORTH.items() if lost[name] - sound[name] >= worth or lost[name] != lost[name]]
    return {"planted": link, "fault": fault_of(link, seed), "world": world, "seed": seed, "status": row["status"],
            "cost": "+".join(cost), "named": named, "right": int(named == link), "missed": lost["places"],
            "missed_without": sound["places"], "patrols": row.get("blame_runs"), "belief_m": lost["belief"],
            "belief_m_without": sound["belief"], "blame": row.get("blame") or row.get("reason") or ""}


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
