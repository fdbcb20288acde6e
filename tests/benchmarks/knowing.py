"""Kidnaps on recorded laps: does a localiser find itself again, and does it know whether it knows?

    python tests/benchmarks/knowing.py --kidnaps 200 --keep results/laps

Per world one survey (seed 0, closed by pose_graph) and one lap 0.2 m and 5 degrees rms off the route (seed 1), both the
same way round; a lap is led in the simulator once and kept (tests/benchmarks/laps.py). A kidnap: the localiser tracks 8
views of the lap from a known start, then the views go on from another, drawn place of the lap, and it is judged over 5 m
of way as rhs.knowing judges it. ece: expected calibration error of the stated chance over ten bins, all views after a
kidnap (reliability.csv holds the bins). `tracked`: the same
localisers led round without a kidnap, on that lap and, where there is one, on a lap the other way round (seed 2). With
--other-way N also N kidnaps from either lap onto the one led the other way round, where no place can be recognised: honest
is to be lost (kidnaps_other_way.csv). Writes results/tables/kidnaps.csv, tracked.csv, reliability.csv and
results/pictures/reliability.png; rows of other worlds that stand in these tables are kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from laps import SETTINGS, Lap, Taken, taken

from rhs.api.contracts import Context
from rhs.api.geometry import inverse, planar, wrap
from rhs.api.randomness import generator
from rhs.api.records import Belief, BeliefStatus, Motion, Tracking
from rhs.config.compose import compose_config
from rhs.estimation.survey import draw
from rhs.metrics.calibration import WITHIN_M, Beliefs, calibration_error, kidnaps, reliability
from rhs.plots.figure import new_figure, save
from rhs.reports.calibration_pictures import draw_reliability
from rhs.worlds.world import load_world

RESULTS = Path(__file__).resolve().parents[2] / "results"
STILL = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
CARRIED = replace(STILL, status=Tracking.LOST)  # whose odometry follows nothing into what it sees there
TRACKED_BEFORE = 8
KIDNAPS = ("world,localiser,kidnaps,recovered,recovery_m,recovery_p90_m,recovery_s,recovery_p90_s,wrong_sure,honest_lost,"
           "ece,update_cpu_ms")
OTHER_WAY = KIDNAPS.replace("world,", "world,carried_from,")
BINS = "world,localiser,stated_chance,share_right,views"
TRACKED = "world,lap,localiser,views,tracking,right,wrong_sure,rmse_m,worst_m,ece"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", nargs="+", default=["square", "square_alike", "square_twin"])
    parser.add_argument("--localisers", nargs="+", default=["sift_db", "particle_filter"])
    parser.add_argument("--kidnaps", type=int, default=200)
    parser.add_argument("--other-way", type=int, default=0)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=RESULTS / "laps")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    lines, tracked, bins, other = [], [], [], []
    for world in options.worlds:
        survey = taken(Lap(world, options.first_seed), options.keep)
        bank = taken(Lap(world, options.first_seed + 1, "ccw", (), 0.2, 5.0), options.keep)
        laps = {"same way": bank}
        if (options.keep / f"{_back(world, options).name}.npz").exists() or world != "square_alike":
            laps["other way"] = taken(_back(world, options), options.keep)
        for name in options.localisers:
            part = learnt(name, survey, world)
            after, spent_ms = kidnapped(part, bank, options.kidnaps)
            lines.append(f"{world},{name}," + kidnap_line(after, spent_ms))
            chance, right = (np.concatenate([getattr(b, word) for b in after]) for word in ("probability", "right"))
            bins += [f"{world},{name},{c:.4f},{r:.4f},{n:.0f}" for c, r, n in reliability(chance, right)]
            for word, lap in laps.items():
                if options.other_way and "other way" in laps:
                    after, spent_ms = kidnapped(part, lap, options.other_way, onto=laps["other way"])
                    other.append(f"{world},{word},{name}," + kidnap_line(after, spent_ms))
                    sys.stdout.write(other[-1] + "\n")
                tracked.append(f"{world},{word},{name}," + tracked_line(part, lap))
            sys.stdout.write("\n".join([lines[-1], *tracked[-len(laps):]]) + "\n")
            sys.stdout.flush()
    for folder in ("tables", "pictures"):
        (options.out / folder).mkdir(parents=True, exist_ok=True)
    kept(options.out / "tables" / "kidnaps.csv", KIDNAPS, lines, options.worlds)
    if other:
        kept(options.out / "tables" / "kidnaps_other_way.csv", OTHER_WAY, other, options.worlds)
    kept(options.out / "tables" / "tracked.csv", TRACKED, tracked, options.worlds)
    all_bins = kept(options.out / "tables" / "reliability.csv", BINS, bins, options.worlds)
    figure = new_figure(7.5, 5.5)
    draw_reliability(figure.add_subplot(), curves_of(all_bins))
    save(figure, options.out / "pictures" / "reliability.png")
    return 0


def kept(path: Path, head: str, lines: list[str], worlds: list[str]) -> list[str]:
    """Write a table whose rows of other worlds stay; all its rows."""
    old = path.read_text().splitlines() if path.exists() else []
    stay = [line for line in old[1:] if old[0] == head and line.split(",")[0] not in worlds]
    path.write_text("\n".join([head, *stay, *lines]) + "\n")
    return [*stay, *lines]


def curves_of(bins: list[str]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """World and localiser -> chances and outcomes that fall into these bins."""
    out: dict[str, list[np.ndarray]] = {}
    for line in bins:
        world, name, chance, share, count = line.split(",")
        outcomes = np.arange(int(count)) < round(float(share) * int(count))
        out.setdefault(f"{world}, {name}", []).append(np.stack([np.full(int(count), float(chance)), outcomes]))
    return {name: (np.hstack(parts)[0], np.hstack(parts)[1] > 0) for name, parts in out.items()}


def _back(world: str, options) -> Lap:
    return Lap(world, options.first_seed + 2, "cw", (), 0.1, 3.0)


def learnt(name: str, survey: Taken, world: str):
    """The localiser with the survey as the robot would have it: closed by pose_graph, its map drawn by `occupancy`."""
    facts = load_world(world).facts()
    context = Context(generator(0, name), survey.camera, facts, Path(), SETTINGS)
    views = survey.views("procrustes")
    closure = compose_config(["loop_closer=pose_graph"]).loop_closer.settings.build(context).close(views)
    views = [replace(view, map_from_body=pose) for view, pose in zip(views, closure.poses, strict=True)]
    part = compose_config([f"localiser={name}"]).localiser.settings.build(context)
    part.learn(views, draw(tuple(views), compose_config(["mapper=occupancy"]).mapper.settings.build(context)))
    return part


def kidnapped(part, bank: Taken, count: int, *, onto: Taken | None = None) -> tuple[list[Beliefs], float]:
    """What the localiser believed after each of `count` kidnaps from one lap onto another (None: the same), and CPU
    milliseconds per update."""
    rng, onto = np.random.default_rng(7), onto or bank
    last, last_onto = (int(np.searchsorted(lap.way_m, lap.way_m[-1] - WITHIN_M - 0.3)) for lap in (bank, onto))
    out, spent_s, views = [], 0.0, 0
    for _ in range(count):
        before, begin = (int(k) for k in rng.integers(0, [last, last_onto]))
        follow(part, bank, before, before + TRACKED_BEFORE)
        end = int(np.searchsorted(onto.way_m, onto.way_m[begin] + WITHIN_M)) + 1
        clock = time.process_time()
        out.append(follow(part, onto, begin, end, start=False))
        spent_s, views = spent_s + time.process_time() - clock, views + end - begin
    return out, 1e3 * spent_s / views


def follow(part, lap: Taken, begin: int, end: int, *, start: bool = True) -> Beliefs:
    """The localiser led over some views of a lap; start: told where it is first."""
    if start:
        part.start(Belief(lap.truth[begin], 1e-3 * np.eye(6)))
    rows = []
    for k in range(begin, end):
        belief = part.update(lap.observations[k], lap.motions["procrustes"][k] if k > begin else STILL if start else CARRIED)
        gap = planar(inverse(lap.truth[k]) @ belief.map_from_body)
        rows.append((lap.observations[k].stamp_s, np.hypot(*gap[:2]), abs(float(wrap(gap[2]))), belief.probability,
                     belief.status is BeliefStatus.TRACKING))
    stamps, wrong_m, wrong_rad, chance, sure = np.array(rows, float).T
    first = np.arange(end - begin) == 0
    return Beliefs(stamps, lap.truth[begin:end, :2, 3], wrong_m, wrong_rad, chance, sure > 0, first, first & start)


def kidnap_line(after: list[Beliefs], spent_ms: float) -> str:
    judged = [kidnaps(beliefs)[0] for beliefs in after]
    metres = np.array([one.metres for one in judged if np.isfinite(one.metres)])
    seconds = np.array([one.seconds for one in judged if np.isfinite(one.seconds)])
    wrong = np.mean([one.wrong_sure for one in judged])
    lost = np.mean([not one.sure[-1] for one in judged])
    chance, right = (np.concatenate([getattr(beliefs, word) for beliefs in after]) for word in ("probability", "right"))
    numbers = [np.percentile(values, q) if len(values) else np.nan for values in (metres, seconds) for q in (50, 90)]
    return (f"{len(judged)},{len(metres) / len(judged):.3f}," + ",".join(f"{x:.2f}" for x in numbers)
            + f",{wrong:.3f},{lost:.3f},{calibration_error(chance, right):.3f},{spent_ms:.1f}")


def tracked_line(part, lap: Taken) -> str:
    """Led round a whole lap from a known start."""
    seen = follow(part, lap, 0, len(lap))
    rmse = float(np.sqrt((seen.wrong_m**2).mean()))
    wrong = np.mean(seen.sure & ~seen.right)
    return (f"{len(lap)},{seen.sure.mean():.3f},{seen.right.mean():.3f},{wrong:.3f},{rmse:.3f},{seen.wrong_m.max():.3f},"
            f"{calibration_error(seen.probability, seen.right):.3f}")


if __name__ == "__main__":
    sys.exit(main())
