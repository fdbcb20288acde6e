"""A localiser on stretches of a real laser log, in a map of it: is it right within 10 m, and is it ever wrong and sure?

    python tests/benchmarks/localise_laser.py ../shared/data/laser/aces.clf.bz2 --part judge --out localise_aces.csv

The whole log is led once (source=replay sensor=laser): its corrected way is the truth, for a log has no other. Maps:
`whole`, the one of that run; `half`, drawn by a run over the first half of the log, localised in on the second half, of
which a part leads through rooms that no map shows. --starts stretches of --way-m metres, evenly spread; the localiser
starts from nothing at each. The first half of the stretches is for tuning (--part tune), the others judge (--part
judge). Right: 0.25 m and 5 degrees; found: right and sure (tracking) within 10 m of way. Starts in rooms that the map
does not show cannot be found, so found_share counts those that lie on mapped ground (nine of ten poses of the first 10
m within 1.5 m of the survey's way); wrong and sure counts every scan of every stretch. Where the calibration error comes
from: bias_seeking and bias_found, the mean stated chance less the share right, of the scans before the first that was
right and sure and of those from it on (below 0: less sure than it could be).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from shared import write

import rhs
from rhs.api.contracts import Context, FeatureSettings, SourceContext
from rhs.api.geometry import inverse, planar, wrap
from rhs.api.randomness import generator
from rhs.api.records import BeliefStatus, Motion, Observation, Tracking
from rhs.api.trajectory import read_tum
from rhs.config.compose import compose_config
from rhs.metrics.calibration import calibration_error
from rhs_tasks.localise.given_map import GivenMap, read_given

STILL = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
FOUND_M, NEAR_M = 10.0, 1.5
Led = tuple[list[Observation], list[Motion], np.ndarray]  # scans, motions, true poses (N, 4, 4)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--work", type=Path, default=None, help="folder for the runs that make truth and map; kept if given")
    parser.add_argument("--map", choices=("whole", "half"), default="whole")
    parser.add_argument("--part", choices=("tune", "judge", "all"), default="all")
    parser.add_argument("--starts", type=int, default=40)
    parser.add_argument("--way-m", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("localise_laser.csv"))
    parser.add_argument("words", nargs="*", help="odometry=wheel localiser.scan_trust=0.2 ...")
    options = parser.parse_intermixed_args()
    with tempfile.TemporaryDirectory() as name:
        work = options.work or Path(name)
        given, first = mapped(options.log, work, options.map)
        led, part = prepared(options.log, work, options.words, options.seed)
    part.learn((), given.grid)
    rows = [stretch(part, led, begin, end, given)
            for begin, end in stretches(led[2], first, options.way_m, options.starts, options.part)]
    table = [row for row, _ in rows]
    table.append(total(rows))
    write(options.out, table)
    sys.stdout.write(options.out.read_text())
    return 0


def mapped(log: Path, work: Path, which: str, more: Sequence[str] = ()) -> tuple[GivenMap, int]:
    """The map, and the first scan that may be asked about. Runs that lie in the folder are taken as they are. more: words of
    the command line for the source."""
    words = ["source=replay", f"source.path={log}", "sensor=laser", "recording=off", "pictures=off", *more]
    if not (work / "whole" / "row.json").exists():
        rhs.run([*words, f"output={work / 'whole'}"], quiet=True)
    truth = read_tum(work / "whole" / "corrected.tum")
    if which == "whole":
        return read_given(str(work / "whole")), 0
    if not (work / "half" / "row.json").exists():
        rhs.run([*words, f"output={work / 'half'}", f"source.count={len(truth) // 2}",
                 f"source.truth={work / 'whole' / 'corrected.tum'}"], quiet=True)
    return read_given(str(work / "half")), len(truth) // 2


def prepared(log: Path, work: Path, words: list[str], seed: int):
    """Every scan of the log with its motion and its true pose, and the localiser."""
    config = compose_config(["task=localise", "source=replay", f"source.path={log}", "sensor=laser", f"seed={seed}",
                             "localiser=particle_filter_scan", *words, f"source.truth={work / 'whole' / 'corrected.tum'}"])
    source = config.source.settings.build(SourceContext(generator(seed, "source"), None, work))
    made = {kind: Context(generator(seed, kind), source.camera, source.facts, work, FeatureSettings())
            for kind in ("sensor", "odometry", "localiser")}
    sensor, odometry, part = (getattr(config, kind).settings.build(context) for kind, context in made.items())
    seen, motions, truths = [], [], []
    while (capture := source.lead()) is not None:
        seen.append(sensor.sense(capture))
        motions.append(odometry.update(seen[-1]))
        truths.append(source.truth())
    source.close()
    return (seen, motions, np.array(truths)), part


def stretches(truths: np.ndarray, first: int, way_m: float, count: int, part: str) -> list[tuple[int, int]]:
    """(begin, end) scans of the stretches asked for."""
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truths[:, :2, 3], axis=0), axis=1))])
    starts_m = np.linspace(along_m[first], along_m[-1] - way_m, count)
    chosen = {"tune": starts_m[: count // 2], "judge": starts_m[count // 2:], "all": starts_m}[part]
    return [(max(first, int(np.searchsorted(along_m, at))), int(np.searchsorted(along_m, at + way_m))) for at in chosen]


def stretch(part, led: Led, begin: int, end: int, given: GivenMap) -> tuple[dict, np.ndarray]:
    """The row of one stretch, and (N, 5) per scan: right, sure, stated chance, CPU seconds, found by then."""
    seen, motions, truths = led
    part.start(None)
    out, way_m, found_m, near = [], 0.0, np.nan, []
    for k in range(begin, end):
        clock = time.process_time()
        belief = part.update(seen[k], motions[k] if k > begin else STILL)
        spent_s = time.process_time() - clock
        way_m += float(np.linalg.norm(truths[k, :2, 3] - truths[max(k - 1, begin), :2, 3]))
        gap = planar(inverse(given.in_map(truths[k])) @ belief.map_from_body)
        right = bool(np.hypot(gap[0], gap[1]) < 0.25 and abs(float(wrap(gap[2]))) < np.radians(5.0))
        sure = belief.status is BeliefStatus.TRACKING
        if right and sure and np.isnan(found_m):
            found_m = way_m
        if way_m <= FOUND_M:
            near.append(np.linalg.norm(given.true_way[:, :2, 3] - truths[k, :2, 3], axis=1).min() < NEAR_M
                        if given.true_way is not None else True)
        out.append((right, sure, belief.probability, spent_s, not np.isnan(found_m)))
    table = np.array(out, float)
    row = {"begin": begin, "scans": end - begin, "on_map": bool(np.mean(near) > 0.9), "found_m": round(found_m, 3)}
    return row | shares(table) | {"found_share": float(found_m <= FOUND_M)}, table


def shares(table: np.ndarray) -> dict:
    """Figures over the scans of a table (N, 5)."""
    right, sure, found = table[:, 0] > 0, table[:, 1] > 0, table[:, 4] > 0
    seeking, after = (table[kept, 2] - right[kept] for kept in (~found, found))
    return {"right_share": round(float(right.mean()), 4), "right_sure_share": round(float((right & sure).mean()), 4),
            "wrong_sure_share": round(float((sure & ~right).mean()), 4),
            "ece": round(calibration_error(table[:, 2], right), 4),
            "bias_seeking": round(float(seeking.mean()), 4) if len(seeking) else np.nan,
            "bias_found": round(float(after.mean()), 4) if len(after) else np.nan,
            "update_cpu_ms": round(1e3 * float(table[:, 3].mean()), 2)}


def total(rows: list[tuple[dict, np.ndarray]]) -> dict:
    """All stretches together; found_m: the median; on_map: how many; found_share: of these, found within 10 m."""
    asked = [row for row, _ in rows if row["on_map"]]
    metres = np.array([row["found_m"] for row in asked])
    found = metres <= FOUND_M
    return {"begin": "all", "scans": sum(row["scans"] for row, _ in rows), "on_map": len(asked),
            "found_m": round(float(np.median(metres[found])), 3) if found.any() else np.nan,
            **shares(np.concatenate([table for _, table in rows])),
            "found_share": round(float(found.mean()), 4) if len(asked) else np.nan}


if __name__ == "__main__":
    sys.exit(main())
