"""The scan-only particle filter on a real laser log: does it find itself, and does it know?

    python tests/benchmarks/laser_log.py ../shared/data/laser/aces.clf.bz2 --out results/tables/laser_log.csv

The first --map-m metres of a CARMEN log (scans and wheels) are led once; their walls straighten the way (pose_graph) and
every other scan draws the map. The filter is then led past the scans left out, with the wheels as its motion: from the known
start, and --starts times for --way-m metres from nothing. Judged against the straightened way, since a log has no other
truth for single poses: right within 0.25 m and 5 degrees.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from shared import write

from rhs.api.contracts import Context, FeatureSettings, SourceContext
from rhs.api.geometry import inverse, orthonormal, planar, wrap
from rhs.api.randomness import generator
from rhs.api.records import Belief, BeliefStatus, Motion, Observation, Tracking, View
from rhs.config.compose import compose_config
from rhs.estimation.survey import close, draw
from rhs.metrics.calibration import calibration_error

STILL = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
Led = tuple[list[Observation], list[Motion], np.ndarray]  # scans, motions from the one before, poses (N, 4, 4)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--map-m", type=float, default=60.0)
    parser.add_argument("--way-m", type=float, default=10.0)
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--out", type=Path, default=Path("laser_log.csv"))
    options = parser.parse_args()
    part, asked = prepared(options.log, options.map_m)
    rows = [row("known start, led to the end", [followed(part, asked, 0, None, start=asked[2][0])])]
    way_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(asked[2][:, :2, 3], axis=0), axis=1))])
    last = int(np.searchsorted(way_m, way_m[-1] - options.way_m))
    begins = np.linspace(0, last, options.starts).astype(int).tolist()
    ends = [int(np.searchsorted(way_m, way_m[begin] + options.way_m)) for begin in begins]
    led = [followed(part, asked, begin, end, start=None) for begin, end in zip(begins, ends, strict=True)]
    rows.append(row(f"from nothing, after {options.way_m:g} m", led, at_end=True))
    write(options.out, rows)
    sys.stdout.write(options.out.read_text())
    return 0


def prepared(log: Path, map_m: float):
    """The filter that knows the map of every other scan, and the other scans with their motions and poses."""
    config = compose_config(["source=replay", f"source.path={log}", "sensor=laser", "odometry=wheel",
                             "localiser=particle_filter_scan"])  # fmt: skip
    closer = compose_config(["loop_closer=pose_graph"]).loop_closer.settings
    with tempfile.TemporaryDirectory() as name:
        source = config.source.settings.build(SourceContext(generator(0, "source"), None, Path(name)))
        context = Context(generator(0, "laser"), source.camera, source.facts, Path(name), FeatureSettings())
        sensor, odometry = (kind.settings.build(context) for kind in (config.sensor, config.odometry))
        views, seen, pose, way_m = [], [], np.eye(4), 0.0
        while way_m < map_m and (capture := source.lead()) is not None:
            observation = sensor.sense(capture)
            motion = odometry.update(observation)
            pose = orthonormal(pose @ motion.previous_from_body) if views else pose
            way_m += float(np.hypot(*motion.previous_from_body[:2, 3])) if views else 0.0
            views.append(View(len(views), observation.stamp_s, observation.camera, motion, pose, 1e-6 * np.eye(6),
                              observation.scan, None))
            seen.append(observation)
        source.close()
    straight, _ = close(tuple(views), closer.build(context))
    part = config.localiser.settings.build(context)
    part.learn([], draw(tuple(straight[0::2]), config.mapper.settings.build(context)))
    moved = [inverse(a.map_from_body) @ b.map_from_body for a, b in zip(views[1:-2:2], views[3::2], strict=False)]
    motions = [STILL, *(replace(v.motion, previous_from_body=m) for v, m in zip(views[3::2], moved, strict=True))]
    return part, (seen[1::2], motions, np.array([view.map_from_body for view in straight[1::2]]))


def followed(part, led: Led, begin: int, end: int | None, *, start: np.ndarray | None) -> np.ndarray:
    """(N, 5) per scan: metres and radians wrong, stated chance, sure (1) or not, CPU seconds of the update."""
    seen, motions, poses = led
    part.start(None if start is None else Belief(start, 1e-3 * np.eye(6)))
    out = []
    for k in range(begin, len(seen) if end is None else end):
        clock = time.process_time()
        belief = part.update(seen[k], motions[k] if k > begin else STILL)
        spent_s = time.process_time() - clock
        gap = planar(inverse(poses[k]) @ belief.map_from_body)
        out.append((np.hypot(gap[0], gap[1]), abs(float(wrap(gap[2]))), belief.probability,
                    belief.status is BeliefStatus.TRACKING, spent_s))
    return np.array(out, float)


def row(what: str, led: list[np.ndarray], *, at_end: bool = False) -> dict:
    """Shares over all scans, or over the last of each way; the calibration error is always over all."""
    every = np.concatenate(led)
    judged = np.array([one[-1] for one in led]) if at_end else every
    right = (judged[:, 0] < 0.25) & (judged[:, 1] < np.radians(5.0))
    sure = judged[:, 3] > 0
    ece = calibration_error(every[:, 2], (every[:, 0] < 0.25) & (every[:, 1] < np.radians(5.0)))
    return {"what": what, "judged": len(judged), "right": float(right.mean()),
            "right_and_sure": float((right & sure).mean()),
            "wrong_and_sure": float((sure & ~right).mean()), "not_sure": float((~sure).mean()),
            "median_wrong_m": float(np.median(judged[:, 0])), "ece": float(ece),
            "update_cpu_ms": float(1e3 * np.median(every[:, 4]))}


if __name__ == "__main__":
    sys.exit(main())
