"""The places task: one survey stored, other views queried one by one; how often is the place right? (thesis 5.2, T3)

Queried are the views of the same lap that were not stored (the thesis), and another lap off the route, which is harder.

Files of the run folder: config.yaml, places.csv (a row per method), precision_recall.csv and .png, places.npz (the memory),
row.json. Stored views stand at their true poses, so that the score is that of recognition and not of odometry.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import FeatureSettings
from rhs.api.files import replacing
from rhs.api.geometry import planar, se2
from rhs.api.records import Knowing, Motion, Observation, Step, Tracking, View
from rhs.api.errors import ConfigError
from rhs.config.compose import RunConfig, identity
from rhs.config.parts import Parts, build
from rhs.estimation.views.features import features
from rhs.estimation.views.place_files import save
from rhs.estimation.views.place_memory import Memory, memory_of
from rhs.patrol.loop import Led, steps
from rhs.patrol.survey import ViewCollector, draw, revise
from rhs.patrol.task_row import run_task
from rhs.reports.calibration_pictures import precision_recall_picture

from .trial import (
    ABSTAINED,
    CORRECT,
    OFF_ROUTE,
    SAME_LAP,
    WRONG,
    Answered,
    Query,
    judge_pose,
    named,
    precision_recall,
    shares,
    trial,
)

QUERY_SEED = 1000  # added to the seed for the lap that is queried: other noise, another wobble
# Columns of the row begin with these words; what is not said to be of the same lap is off the route.
COLUMNS = {"loc": f"{OFF_ROUTE}: votes", "loc_check": f"{OFF_ROUTE}: vlad+check", "loc_same_lap": f"{SAME_LAP}: votes",
           "loc_same_lap_check": f"{SAME_LAP}: vlad+check", "loc_sequence": "sequence"}
STILL = Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)


def run_places_config(config: RunConfig, folder: Path) -> dict[str, Any]:
    """Run the task and return its row, written whatever the outcome; the cause of a failure stands under `_cause`."""
    if "driving" not in config.source.settings.provides:
        raise ConfigError("task=places needs a simulated world; type source=simulator")
    return run_task(identity(config), config, folder, lambda: run_places(config, folder))


def run_places(config: RunConfig, folder: Path) -> dict[str, Any]:
    """Survey, query, judge; the columns of the row."""
    stored, parts = lap(config, folder, seed=config.seed)
    queried, _ = lap(config, folder, seed=config.seed + QUERY_SEED, off_route=True)
    views = [replace(v, features=v.features if k % config.places.every == 0 else None) for k, (v, _) in enumerate(stored)]
    memory = memory_of(views)
    save(memory, folder / "places.npz")
    asked = [step for k, step in enumerate(queried) if k % config.places.ask_every == 0]
    queries = [Query(view.features, view.camera, view.map_from_body) for view, _ in asked if view.features is not None]
    rest = [_query(view, step, config) for k, (view, step) in enumerate(stored) if views[k].features is None]
    checks, seed = config.places.checks, config.seed
    answers = named(SAME_LAP, trial(memory, rest, checks=checks, seed=seed, kinds=("votes", "vlad")))
    answers |= named(OFF_ROUTE, trial(memory, queries, checks=checks, seed=seed))
    answers["sequence"] = sequences(parts, views, queried, config)
    write_tables(folder, answers)
    precision_recall_picture(folder)
    return columns(memory, answers)


def _query(view: View, step: Step, config: RunConfig) -> Query:
    """A view as it was taken: what the odometry said about walls later is not known to it."""
    shared = FeatureSettings(config.features.count, config.features.contrast, config.features.ratio)
    return Query(features(step.observation, shared), view.camera, view.map_from_body)


def lap(config: RunConfig, folder: Path, *, seed: int, off_route: bool = False) -> tuple[list[tuple[View, Step]], Parts]:
    """One led lap as (view at its true pose, step) pairs, key-points in every view, and the parts it was led with.

    off_route: led `places.off_route_m` rms beside the route and `places.off_route_deg` off its heading; its views are
    queries and stay as they were taken. The others are stored: with one eye their key-points get the depths of the walls
    that the odometry settled on, errors and all."""
    from rhs.worlds.world import load_world

    chosen = dict(config.chosen())
    if off_route:
        places, led_as = config.places, chosen["source"].settings
        wobbling = replace(led_as, wobble_m=places.off_route_m, wobble_deg=places.off_route_deg)
        chosen["source"] = replace(chosen["source"], settings=wobbling)
    shared = FeatureSettings(config.features.count, config.features.contrast, config.features.ratio)
    parts = build(chosen, seed=seed, world=load_world(config.world), folder=folder, features=shared)
    try:
        collector = ViewCollector(1, shared, features)
        led = Led(se2(*parts.source.facts.start), parts.mapper)
        taken = list(collector.watch(steps(parts.source, parts.sensor, parts.odometry, led, who=parts.who)))
    finally:
        parts.source.close()
    views = collector.views if off_route else revise(collector.views, parts.odometry, who=parts.who["odometry"])[0]
    out = []
    for view, step in zip(views, taken, strict=True):
        assert step.truth is not None, "the simulator knows where it is"
        out.append((replace(view, map_from_body=step.truth), step))
    return out, parts


def sequences(parts: Parts, views: list[View], queried: list[tuple[View, Step]], config: RunConfig) -> list[Answered]:
    """The localiser started from nothing at many views of the queried lap and led for `places.sequence_m`: right, or wrong
    and sure of it, or (abstained) honest about not knowing."""
    parts.localiser.learn(views, draw(tuple(views), parts.mapper, who=parts.who["mapper"]))
    out = []
    last = len(queried) - 1
    for begin in np.linspace(0, 0.9 * last, config.places.sequences).astype(int):
        parts.localiser.start(None)
        way_m, k = 0.0, int(begin)
        belief = parts.localiser.update(_seen(queried[k][1]), STILL)
        while way_m < config.places.sequence_m and k < last:
            k += 1
            step = queried[k][1]
            way_m += float(np.hypot(*planar(step.motion.previous_from_body)[:2]))
            belief = parts.localiser.update(_seen(step), step.motion)
        sure = belief.status is Knowing.TRACKING
        pose = belief.map_from_body if sure else None
        out.append(Answered(judge_pose(pose, queried[k][0].map_from_body), belief.probability))
    return out


def _seen(step: Step) -> Observation:
    return step.observation


def columns(memory: Memory, answers: dict[str, list[Answered]]) -> dict[str, Any]:
    """The row: the plain vote under the thesis's names, the best check and the sequence beside it."""
    out: dict[str, Any] = {"places_stored": len(memory), "queries": len(answers[f"{OFF_ROUTE}: votes"])}
    for prefix, method in COLUMNS.items():
        out.update({f"{prefix}_{name}": value for name, value in shares(answers[method]).items()})
    return out


def write_tables(folder: Path, answers: dict[str, list[Answered]]) -> None:
    """places.csv: a row per method; precision_recall.csv: the curves of the retrievals and their checks."""
    lines = ["method,queries,correct,near,wrong,abstained,precision\n"]
    curve = ["method,threshold,precision,recall\n"]
    for method, given in answers.items():
        share = shares(given)
        said = 1.0 - share[ABSTAINED]
        precision = share[CORRECT] / said if said > 0 else float("nan")
        values = ",".join(f"{share[o]:.4f}" for o in (CORRECT, "near", WRONG, ABSTAINED))
        lines.append(f"{method},{len(given)},{values},{precision:.4f}\n")
        curve += [f"{method},{t:.5g},{p:.4f},{r:.4f}\n" for t, p, r in precision_recall(given)]
    for name, text in (("places.csv", lines), ("precision_recall.csv", curve)):
        with replacing(folder / name) as file:
            file.write("".join(text))


def told(folder: Path) -> str:
    """places.csv as text, with the thesis's figures above ours."""
    rows = [line.split(",") for line in (folder / "places.csv").read_text(encoding="utf-8").splitlines()]
    rows.insert(1, ["thesis (votes)", "-", "0.80", "0.08", "0.12", "-", "-"])
    return "\n".join(f"{row[0]:<28}" + "".join(f"{cell:>11}" for cell in row[1:]) for row in rows)
