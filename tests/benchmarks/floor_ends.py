"""How well does sensor=stereo know where the floor ends before a plain wall, at which distance?

    python tests/benchmarks/floor_ends.py --buildings non_manhattan/5545 hall/741 ladder/2826

The first views of each survey twice, as two eyes see them and as a depth camera without noise does, whose scan is the truth
(`rhs.estimation.scans.floor_end`; ends are asked for to 9 m here, whatever `range_m` says). off_m: end less truth, metres.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from itertools import islice

import numpy as np

import rhs
from rhs.base.provenance import commit
from rhs.estimation.scans.floor_end import FloorEnds
from rhs.estimation.scans.obstacle_scan import ObstacleScanner
from rhs.estimation.scans.settings import FloorEndSettings
from rhs_sensors.stereo import StereoAdvanced

BANDS_M = (0.0, 1.5, 2.5, 3.5, 4.5, 6.0, 9.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--buildings", nargs="+", default=["non_manhattan/5545", "hall/741", "ladder/2826"])
    parser.add_argument("--views", type=int, default=60, help="of each survey")
    options = parser.parse_args()
    found = np.concatenate([np.reshape(list(ends(building, options.views)), (-1, 2)) for building in options.buildings])
    lines = [f"{'truth':>10}  {'columns':>7}  {'median off_m':>12}  {'5 %':>6}  {'95 %':>6}"]
    for low, high in zip(BANDS_M[:-1], BANDS_M[1:], strict=True):
        off = np.diff(found[(found[:, 0] >= low) & (found[:, 0] < high)])[:, 0]
        if len(off):
            five, middle, most = np.percentile(off, [5, 50, 95])
            lines.append(f"{low:.1f}-{high:.1f} m  {len(off):>7}  {middle:>12.3f}  {five:>6.3f}  {most:>6.3f}")
    sys.stdout.write("\n".join([*lines, f"commit: {commit()}", ""]))
    return 0


def ends(building: str, views: int) -> Iterator[tuple[float, float]]:
    """(truth, end), metres, of every column that has both."""
    words = [f"world=random:{building}", f"seed={building.split('/')[1]}", "task=survey", "recording=off", "pictures=off"]
    exact = ["sensor=rgbd", "sensor.noise=false", "sensor.max_range_m=20"]
    truth = [step.scan for step in islice(rhs.steps([*words, *exact]), views)]
    reader = None
    for step, scan in zip(rhs.steps([*words, "sensor=stereo"]), truth, strict=False):
        if reader is None:
            scanner = ObstacleScanner(step.observation.camera, StereoAdvanced().obstacle, max_range_m=BANDS_M[-1])
            reader = FloorEnds(scanner, FloorEndSettings(range_m=BANDS_M[-1]), sure_m=np.inf)
        z = scanner.thinned(step.observation.depth)
        end_m = reader.ranges(z, scanner.floor(z))
        true_m = np.interp(scanner.bearings_rad, scan.bearings_rad, scan.ranges_m)
        known = np.isfinite(end_m) & np.isfinite(true_m)
        yield from zip(true_m[known].tolist(), end_m[known].tolist(), strict=True)


if __name__ == "__main__":
    sys.exit(main())
