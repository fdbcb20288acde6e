"""What places cost at 320x240, in CPU milliseconds: a query, the particle filter, the scan match, closing a survey.

    python tests/benchmarks/place_times.py --keep results/laps

On a survey of square_alike and a lap beside it (tests/benchmarks/laps.py); key-points are those of views rendered now.
Medians over the repetitions. Writes results/tables/place_times.csv.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from laps import SETTINGS, Lap, taken

from rhs.api.contracts import Context, SourceContext
from rhs.api.geometry import planar
from rhs.api.randomness import generator
from rhs.api.records import Belief, Observation
from rhs.config.compose import compose_config
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.survey import draw
from rhs.estimation.views.features import features
from rhs.estimation.views.place_database import PlaceDatabase, PlaceSettings
from rhs.estimation.views.place_memory import memory_of
from rhs.worlds.world import load_world

TABLE = Path(__file__).resolve().parents[2] / "results" / "tables" / "place_times.csv"
WORLD = "square_alike"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, default=TABLE.parents[1] / "laps")
    parser.add_argument("--out", type=Path, default=TABLE)
    options = parser.parse_args()
    survey = taken(Lap(WORLD, 0), options.keep)
    beside = taken(Lap(WORLD, 1000, "ccw", (), 0.3, 8.0), options.keep)
    views = survey.views("procrustes")
    context = Context(generator(0, "times"), survey.camera, load_world(WORLD).facts(), Path(), SETTINGS)
    grid = draw(tuple(views), compose_config(["mapper=occupancy"]).mapper.settings.build(context))
    chosen = list(range(20, len(beside) - 20, 12))
    lines = ["what,goal_ms,cpu_ms,p90_ms,repetitions"]
    images = rendered(20)
    lines.append(line("key-points of a view", "", [spent(lambda o=o: features(o, SETTINGS)) for o in images]))
    database = PlaceDatabase(memory_of(views), PlaceSettings(), np.random.default_rng(0))
    database.ask(beside.features[0], beside.camera)
    asked = [spent(lambda k=k: database.ask(beside.features[k], beside.camera)) for k in chosen]
    lines.append(line("query with VLAD and 5 checks; 135 views stored", "", asked))
    both = [a + b for a, b in zip(asked, [spent(lambda o=o: features(replace(o), SETTINGS)) for o in images], strict=False)]
    lines.append(line("query from the image on", "60", both))
    for world_words, name in ((("localiser.likeness_trust=0",), "scan"), ((), "scan and likeness")):
        lines.append(line(f"1000 particles, one update ({name})", "2", updates(context, views, grid, beside, world_words)))
    matcher, prior = ScanMatcher(grid), np.diag([0.04, 0.04, 0.01])
    matched = [spent(lambda k=k: matcher.match(beside.observations[k].scan, planar(beside.truth[k]), prior)) for k in chosen]
    lines.append(line("scan laid onto the map", "", matched))
    for closer in ("error_distribution", "pose_graph"):
        lines.append(line(f"closing and rebuilding {len(views)} steps ({closer})", "1000", closings(context, views, closer)))
    text = "\n".join(lines) + "\n"
    options.out.write_text(text)
    sys.stdout.write(text)
    return 0


def spent(work: Callable[[], object]) -> float:
    """CPU milliseconds of one call."""
    begin = time.process_time()
    work()
    return 1e3 * (time.process_time() - begin)


def line(what: str, goal: str, values: list[float]) -> str:
    return f"{what},{goal},{np.median(values):.1f},{np.percentile(values, 90):.1f},{len(values)}"


def rendered(count: int) -> list[Observation]:
    """Views of the survey, as the sensor reports them."""
    config = compose_config([f"world={WORLD}", "sensor=rgbd"])
    with tempfile.TemporaryDirectory() as name:
        source = config.source.settings.build(SourceContext(generator(0, "source"), load_world(WORLD), Path(name)))
        context = Context(generator(0, "sensor"), source.camera, source.facts, Path(name), SETTINGS)
        sensor = config.sensor.settings.build(context)
        out = [sensor.sense(source.lead()) for _ in range(count)]
        source.close()
    return out


def updates(context: Context, views, grid, lap, words) -> list[float]:
    """The filter with 1000 particles; views are checked by geometry so seldom that it does not count."""
    fixed = ["localiser.particles_min=1000", "localiser.particles_max=1000", "localiser.check_every=10000"]
    part = compose_config(["localiser=particle_filter", *fixed, *words]).localiser.settings.build(context)
    part.learn(views, grid)
    part.start(Belief(lap.truth[0], 1e-3 * np.eye(6)))
    part.update(lap.observations[0], lap.motions["procrustes"][0])
    return [spent(lambda k=k: part.update(lap.observations[k], lap.motions["procrustes"][k])) for k in range(1, 60)]


def closings(context: Context, views, closer: str) -> list[float]:
    out = []
    for _ in range(3):
        part = compose_config([f"loop_closer={closer}"]).loop_closer.settings.build(context)
        mapper = compose_config(["mapper=occupancy"]).mapper.settings.build(context)

        def work(part=part, mapper=mapper):
            poses = part.close(views).poses
            draw(tuple(replace(view, map_from_body=pose) for view, pose in zip(views, poses, strict=True)), mapper)

        out.append(spent(work))
    return out


if __name__ == "__main__":
    sys.exit(main())
