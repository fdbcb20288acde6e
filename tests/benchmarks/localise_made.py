"""A localiser in maps of made logs (`laser_made.py`): does a setting pay where nobody looked?

    python tests/benchmarks/localise_made.py --seeds 6000-6007 --variants '' localiser.advanced.fit.rival_weight=0

One row per log, map and variant. Every log is drawn once and led once; each variant (words of the command line, separated by
blanks) then localises on the same stretches of it, in the map of the whole log and in the one of its first half, as
`localise_laser.py` does. The truth is the corrected way, in which the maps were drawn: how far that is from the made one is
`laser_made.py`'s question.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
from laser_buildings import KINDS
from laser_made import made
from localise_laser import mapped, prepared, stretch, stretches, total
from shared import write

from rhs.api.geometry import wrap

MEANS = ("right_share", "right_sure_share", "wrong_sure_share", "ece", "found_share", "update_cpu_ms")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0-3", help="FIRST-LAST")
    parser.add_argument("--kinds", nargs="*", default=KINDS, help="also lab and wing, one of each for every seed")
    parser.add_argument("--way-m", type=float, nargs=2, default=(150.0, 250.0), help="least and most way")
    parser.add_argument("--maps", nargs="*", default=("whole", "half"))
    parser.add_argument("--starts", type=int, default=6)
    parser.add_argument("--stretch-m", type=float, default=20.0)
    parser.add_argument("--least-m", type=float, default=0.0, help="scans nearer to the last one kept are left out")
    parser.add_argument("--variants", nargs="*", default=[""], help="words of the command line, in quotes")
    parser.add_argument("--out", type=Path, default=Path("localise_made.csv"))
    options = parser.parse_args()
    first, last = (int(word) for word in options.seeds.split("-"))
    rows: list[dict] = []
    for seed in range(first, last + 1):
        for kind in (KINDS[seed % 4], "lab", "wing"):
            if kind in options.kinds:
                with tempfile.TemporaryDirectory() as name:
                    rows += of_log(kind, seed, Path(name), options)
                write(options.out, rows)
    for which in options.maps:
        for variant in options.variants:
            scans = [row for row in rows if (row["map"], row["variant"]) == (which, variant)]
            words = [f"{column}={pooled(scans, column):.4f}" for column in MEANS]
            sys.stdout.write(f"{which} map, '{variant}', {len(scans)} logs: {' '.join(words)}\n")
    return 0


def of_log(kind: str, seed: int, work: Path, options: argparse.Namespace) -> list[dict]:
    """The rows of one log."""
    log = work / "made.log"
    facts, _ = made(log, (kind, seed), options.way_m)
    log.write_text("".join(kept([line for line in log.open() if line.startswith("FLASER")], options.least_m)))
    words, rows = [f"source.laser_fov_deg={facts['fov_deg']:g}"], []
    for which in options.maps:
        given, first = mapped(log, work, which, words)
        for variant in options.variants:
            led, part = prepared(log, work, [*words, *variant.split()], 0)
            part.learn((), given.grid)
            asked = stretches(led[2], first, options.stretch_m, options.starts, "all")
            whole = total([stretch(part, led, begin, end, given) for begin, end in asked])
            rows.append({"kind": kind, "seed": seed, "map": which, "variant": variant} | whole)
            sys.stdout.write(" ".join(str(value) for value in rows[-1].values()) + "\n")
            sys.stdout.flush()
    return rows


def kept(lines: list[str], least_m: float) -> list[str]:
    """Of the scans of a log (without its truth, which is the corrected way here) those so far, or as many radians turned,
    from the last one kept, by the wheels."""
    wheels = np.array([line.split()[-6:-3] for line in lines], float)
    out = [0]
    for k in range(1, len(lines)):
        x_m, y_m, yaw_rad = wheels[k] - wheels[out[-1]]
        if np.hypot(x_m, y_m) >= least_m or abs(wrap(yaw_rad)) >= least_m:
            out.append(k)
    return [lines[k] for k in out]


def pooled(rows: list[dict], column: str) -> float:
    """The mean of a column over logs; found_share: over all starts on mapped ground."""
    weights = [row["on_map"] if column == "found_share" else 1 for row in rows]
    told = [(row[column], weight) for row, weight in zip(rows, weights, strict=True) if weight]
    return sum(value * weight for value, weight in told) / max(sum(weight for _, weight in told), 1)


if __name__ == "__main__":
    sys.exit(main())
