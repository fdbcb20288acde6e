"""The single-image score of thesis 5.2 on recorded laps of several seeds, and sequences: the places task without rendering.

    python tests/benchmarks/place_trials.py --keep results/laps --seeds 4 --sequences 125

The same functions as `python -m rhs experiment=places` (rhs.places_task, rhs.place_trial), over laps that are led once and
kept. Per seed every third view of a survey of square_alike at its true pose is stored. Asked alone are the other views of
that lap (rows "same lap", the thesis's protocol) and every third view of another lap, 0.3 m and 8 degrees rms off the route
(rows "off the route"). `sequence`: the particle filter started from nothing and led 3 m; --only-sequences measures only
these and puts their row into the table that is there, --sequences 0 leaves that row as it is.
Writes results/tables/places.csv, places_abstained.csv (every query not answered rightly, with its reason) and
results/pictures/precision_recall.png.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from knowing import STILL
from laps import SETTINGS, Lap, Taken, taken

from rhs.api.contracts import Context
from rhs.api.geometry import planar
from rhs.api.randomness import generator
from rhs.api.records import BeliefStatus
from rhs.config.compose import compose_config
from rhs.estimation.survey import draw
from rhs.estimation.views.place_database import PlaceDatabase, PlaceSettings
from rhs.estimation.views.place_memory import memory_of
from rhs.estimation.views.settings import PlaceRules
from rhs.reports.calibration_pictures import precision_recall_picture
from rhs.worlds.world import load_world
from rhs_tasks.places.task import write_tables
from rhs_tasks.places.trial import CORRECT, OFF_ROUTE, SAME_LAP, SECOND_LOOK, Answered, Query, judge_pose, named, trial

RESULTS = Path(__file__).resolve().parents[2] / "results"
WORLD, SEQUENCE_M, STORED_EVERY, ASK_EVERY = "square_alike", 3.0, 3, 3
KINDS = ("votes", "kd_tree", "vlad")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, default=RESULTS / "laps")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--sequences", type=int, default=125)
    parser.add_argument("--only-sequences", action="store_true")
    parser.add_argument("--own-textures", action="store_true", help="every seed sees another building, not only other noise")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    answers: dict[str, list[Answered]] = {}
    missed = ["queries,seed,view,x_m,y_m,yaw_deg,key_points,outcome,reason,best_score,second_score,best_is\n"]
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        words = (f"source.texture_seed={seed}",) if options.own_textures else ()
        stored = taken(Lap(WORLD, seed, "ccw", words), options.keep)
        asked = taken(Lap(WORLD, 1000 + seed, "ccw", words, 0.3, 8.0), options.keep)
        if options.only_sequences:
            answers.setdefault("sequence", []).extend(sequences(stored, asked, options.sequences))
            continue
        memory = memory_of(stored.views("procrustes", true_poses=True))
        rest = [k for k in range(len(stored) - 1) if k % STORED_EVERY]
        beside = list(range(0, len(asked), ASK_EVERY))
        for protocol, lap, which, kinds in ((SAME_LAP, stored, rest, KINDS[::2]), (OFF_ROUTE, asked, beside, KINDS)):
            queries = [Query(lap.features[k], lap.camera, lap.truth[k]) for k in which]
            for method, given in named(protocol, trial(memory, queries, checks=5, seed=seed, kinds=kinds)).items():
                answers.setdefault(method, []).extend(given)
            missed += misses(seed, memory, lap, which, protocol)
            sys.stdout.write(f"seed {seed}: {len(queries)} queries, {protocol}\n")
            sys.stdout.flush()
        if options.sequences:
            answers.setdefault("sequence", []).extend(sequences(stored, asked, options.sequences))
    if options.only_sequences:
        return replace_row(options.out / "tables" / "places.csv", answers)
    before = [line for line in kept_rows(options.out / "tables" / "places.csv") if line.startswith("sequence,")]
    write_tables(options.out / "tables", answers)
    if not options.sequences:
        with (options.out / "tables" / "places.csv").open("a") as file:
            file.writelines(f"{line}\n" for line in before)
    (options.out / "tables" / "places_abstained.csv").write_text("".join(missed))
    precision_recall_picture(options.out / "tables").replace(options.out / "pictures" / "precision_recall.png")
    sys.stdout.write((options.out / "tables" / "places.csv").read_text())
    return 0


def replace_row(table: Path, answers: dict[str, list[Answered]]) -> int:
    """The rows of these answers take the place of those in the table; the others stay."""
    with tempfile.TemporaryDirectory() as name:
        write_tables(Path(name), answers)
        fresh = (Path(name) / "places.csv").read_text().splitlines()[1:]
    names = {line.split(",")[0] for line in fresh}
    stay = [line for line in kept_rows(table) if line.split(",")[0] not in names]
    table.write_text("\n".join([*stay, *fresh]) + "\n")
    sys.stdout.write("\n".join(fresh) + "\n")
    return 0


def kept_rows(table: Path) -> list[str]:
    """Lines of a table, none if it is not there."""
    return table.read_text().splitlines() if table.exists() else []


def misses(seed: int, memory, asked: Taken, which: list[int], protocol: str) -> list[str]:
    """A line per query that VLAD with the check did not answer rightly; what a query costs goes to the screen."""
    settings = PlaceSettings(rules=PlaceRules(faint_checks=SECOND_LOOK))
    database, out, spent_s, count = PlaceDatabase(memory, settings, np.random.default_rng(seed)), [], 0.0, 0
    for k in which:
        begin = time.process_time()
        answer = database.ask(asked.features[k], asked.camera)
        spent_s, count = spent_s + time.process_time() - begin, count + 1
        outcome = judge_pose(answer.best.map_from_body if answer.best else None, asked.truth[k])
        if outcome != CORRECT:
            x, y, yaw = planar(asked.truth[k])
            scores = [item.score for item in answer.distinct] + [0.0, 0.0]
            top = judge_pose(answer.distinct[0].map_from_body, asked.truth[k]) if answer.distinct else "-"
            out.append(f"{protocol},{seed},{k},{x:.2f},{y:.2f},{np.degrees(yaw):.0f},{len(asked.features[k].pixels)},{outcome},"
                       f"{answer.reason},{scores[0]:.3f},{scores[1]:.3f},{top}\n")
    sys.stdout.write(f"seed {seed}, {protocol}: a query with its check takes {1e3 * spent_s / count:.1f} ms of CPU time\n")
    return out


def sequences(stored: Taken, asked: Taken, count: int) -> list[Answered]:
    """The particle filter from nothing, led SEQUENCE_M: right, wrong and sure of it, or honest about not knowing."""
    context = Context(generator(0, "particle_filter"), stored.camera, load_world(WORLD).facts(), Path(), SETTINGS)
    part = compose_config(["localiser=particle_filter"]).localiser.settings.build(context)
    views = stored.views("procrustes", true_poses=True)
    part.learn(views, draw(tuple(views), compose_config(["mapper=occupancy"]).mapper.settings.build(context)))
    out = []
    for begin in np.linspace(0, 0.9 * (len(asked) - 1), count).astype(int).tolist():
        part.start(None)
        way_m, k = 0.0, begin
        belief = part.update(asked.observations[k], STILL)
        while way_m < SEQUENCE_M and k < len(asked) - 1:
            k += 1
            motion = asked.motions["procrustes"][k]
            way_m += float(np.hypot(*planar(motion.previous_from_body)[:2]))
            belief = part.update(asked.observations[k], motion)
        sure = belief.status is BeliefStatus.TRACKING
        out.append(Answered(judge_pose(belief.map_from_body if sure else None, asked.truth[k]), belief.probability))
    return out


if __name__ == "__main__":
    sys.exit(main())
