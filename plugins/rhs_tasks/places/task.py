"""The places task: one survey stored, other views queried one by one; how often is the place right? (thesis 5.2, T3)

Queried are the views of the same lap that were not stored (the thesis), and another lap off the route, which is harder.

Files of the run folder: config.yaml, places.csv (a row per method), precision_recall.csv and .png, places.npz (the memory),
row.json. Stored views stand at their true poses, so that the score is that of recognition and not of odometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.files import replacing
from rhs.api.geometry import planar
from rhs.api.records import Belief, BeliefStatus, Motion, Step, Tracking, View
from rhs.api.task import Parts, TaskContext, Value
from rhs.api.validate import check_belief
from rhs.estimation.survey import ViewCollector, draw, revise
from rhs.estimation.views.features import features
from rhs.estimation.views.place_files import save
from rhs.estimation.views.place_memory import Memory, memory_of

from .settings import Recognition
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


class PlacesJob:
    """Survey, query, judge."""

    def __init__(self, settings: Recognition, context: TaskContext) -> None:
        self.settings, self.context = settings, context

    def run(self) -> Mapping[str, Value]:
        """The columns of the row; places.csv and precision_recall.csv hold the tables."""
        settings, folder, seed = self.settings, self.context.folder, self.context.seed
        stored, parts = lap(self.context, settings, seed=seed)
        queried, _ = lap(self.context, settings, seed=seed + QUERY_SEED, off_route=True)
        views = [replace(v, features=v.features if k % settings.every == 0 else None) for k, (v, _) in enumerate(stored)]
        memory = memory_of(views)
        save(memory, folder / "places.npz")
        asked = [step for k, step in enumerate(queried) if k % settings.ask_every == 0]
        queries = [Query(view.features, view.camera, view.map_from_body) for view, _ in asked if view.features is not None]
        # as they were taken: what the odometry said about walls later is not known to a query
        rest = [Query(features(step.observation, self.context.features), view.camera, view.map_from_body)
                for k, (view, step) in enumerate(stored) if views[k].features is None]
        answers = named(SAME_LAP, trial(memory, rest, checks=settings.checks, seed=seed, kinds=("votes", "vlad")))
        answers |= named(OFF_ROUTE, trial(memory, queries, checks=settings.checks, seed=seed))
        answers["sequence"] = sequences(parts, views, queried, settings)
        write_tables(folder, answers)
        return columns(memory, answers)


def lap(context: TaskContext, settings: Recognition, *, seed: int, off_route: bool = False,
        ) -> tuple[list[tuple[View, Step]], Parts]:
    """One led lap as (view at its true pose, step) pairs, key-points in every view, and the parts it was led with.

    off_route: led `places.off_route_m` rms beside the route and `places.off_route_deg` off its heading; its views are
    queries and stay as they were taken. The others are stored: with a single camera their key-points get the depths of the
    walls that the odometry settled on, errors and all."""
    wobble = {"source": {"wobble_m": settings.off_route_m, "wobble_deg": settings.off_route_deg}}
    parts = context.parts(seed=seed, changes=wobble if off_route else {})
    try:
        collector = ViewCollector(1, context.features, features)
        taken = list(collector.watch(context.lead(parts)))
    finally:
        parts.source.close()
    views = collector.views if off_route else revise(collector.views, parts.odometry, who=parts.who["odometry"])[0]
    out = []
    for view, step in zip(views, taken, strict=True):
        assert step.truth is not None, "the simulator knows where it is"
        out.append((replace(view, map_from_body=step.truth), step))
    return out, parts


def sequences(parts: Parts, views: list[View], queried: list[tuple[View, Step]],
              settings: Recognition) -> list[Answered]:
    """The localiser started from nothing at many views of the queried lap and led for `places.sequence_m`: right, or wrong
    and sure of it, or (abstained) honest about not knowing."""
    parts.localiser.learn(tuple(views), draw(tuple(views), parts.mapper, who=parts.who["mapper"]))
    out = []
    last = len(queried) - 1
    for begin in np.linspace(0, 0.9 * last, settings.sequences).astype(int):
        parts.localiser.start(None)
        way_m, k = 0.0, int(begin)
        belief = _believed(parts, queried[k][1], STILL)
        while way_m < settings.sequence_m and k < last:
            k += 1
            step = queried[k][1]
            way_m += float(np.hypot(*planar(step.motion.previous_from_body)[:2]))
            belief = _believed(parts, step, step.motion)
        sure = belief.status is BeliefStatus.TRACKING
        pose = belief.map_from_body if sure else None
        out.append(Answered(judge_pose(pose, queried[k][0].map_from_body), belief.probability))
    return out


def _believed(parts: Parts, step: Step, motion: Motion) -> Belief:
    return check_belief(parts.localiser.update(step.observation, motion), who=parts.who["localiser"])


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
