"""Single-image global localisation, the thesis's protocol (section 5.2), as pure functions.

Every third view of a survey is stored; other views are queried alone: the rest of the same lap (the thesis), or another lap
off the route, which is harder. Definitions (the thesis gives none in metres):

an answer that names a stored view (plain votes): correct if it is the stored view nearest to where the query was taken
or a direct neighbour of it (within 0.65 m and 31 degrees, one storing distance); near if it stands within 3 m and 45
degrees of the query, the same stretch of corridor; wrong otherwise.

an answer that is a pose (after the geometric check): correct within 0.25 m and 5 degrees; near within 1 m and 15 degrees;
wrong otherwise; abstained when no pose is given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import Camera, inverse, planar, wrap
from rhs.api.records import Features
from rhs.estimation.views.place_database import PlaceDatabase
from rhs.estimation.views.place_memory import Memory
from rhs.estimation.views.retrieval import Retrieval
from rhs.estimation.views.settings import PlaceRules, PlaceSettings

SAME_LAP, OFF_ROUTE = "same lap", "off the route"  # where the queries are taken
SECOND_LOOK = 12  # candidates of PlaceRules.faint_checks: a single view has no next one
RULES = PlaceRules(faint_checks=SECOND_LOOK)
CORRECT, NEAR, WRONG, ABSTAINED = "correct", "near", "wrong", "abstained"
OUTCOMES = (CORRECT, NEAR, WRONG, ABSTAINED)


@dataclass(frozen=True, eq=False)
class Query:
    """Key-points of one view, its camera, and where it was truly taken (4x4); the truth is for the judge only."""

    features: Features
    camera: Camera
    truth: np.ndarray


@dataclass(frozen=True)
class Answered:
    """One query: its outcome, and the confidence (larger is surer) that a threshold could be put on."""

    outcome: str
    confidence: float


def judge_view(memory: Memory, named: int | None, truth: np.ndarray) -> str:
    """Outcome of an answer that names a stored view."""
    if named is None:
        return ABSTAINED
    x_m, y_m, yaw_rad = planar(truth)
    stands = memory.stands
    cost = np.hypot(stands[:, 0] - x_m, stands[:, 1] - y_m) + 2.0 * np.abs(wrap(stands[:, 2] - yaw_rad))
    if _within(memory.poses[int(cost.argmin())], memory.poses[named], 0.65, 31.0):
        return CORRECT
    return NEAR if _within(truth, memory.poses[named], 3.0, 45.0) else WRONG


def judge_pose(found: np.ndarray | None, truth: np.ndarray) -> str:
    """Outcome of an answer that is a pose (4x4) or None."""
    if found is None:
        return ABSTAINED
    if _within(truth, found, 0.25, 5.0):
        return CORRECT
    return NEAR if _within(truth, found, 1.0, 15.0) else WRONG


def named_views(memory: Memory, retrieval: Retrieval, queries: Sequence[Query]) -> list[Answered]:
    """Each query answered by the best-ranked stored view, unchecked."""
    out = []
    for query in queries:
        if len(query.features.pixels) < 2:
            out.append(Answered(ABSTAINED, 0.0))
            continue
        ranked, scores = retrieval.rank(query.features.descriptors, 1)
        out.append(Answered(judge_view(memory, int(ranked[0]), query.truth), float(scores[0])))
    return out


def checked_poses(database: PlaceDatabase, queries: Sequence[Query]) -> list[Answered]:
    """Each query answered by a verified pose, or not at all. Confidence: the lead in support over the second place that
    the picture does not refute."""
    out = []
    for query in queries:
        answer = database.ask(query.features, query.camera)
        pose = answer.best.map_from_body if answer.best is not None else None
        scores = [item.score for item in answer.distinct] + [0.0, 0.0]
        out.append(Answered(judge_pose(pose, query.truth), scores[0] - scores[1]))
    return out


def named(protocol: str, answers: Mapping[str, list[Answered]]) -> dict[str, list[Answered]]:
    """The methods under the name of the protocol they were asked by."""
    return {f"{protocol}: {method}": given for method, given in answers.items()}


def shares(answers: Sequence[Answered]) -> dict[str, float]:
    """Outcome -> share of all queries; NaN without queries."""
    count = len(answers)
    return {o: sum(a.outcome == o for a in answers) / count if count else float("nan") for o in OUTCOMES}


def precision_recall(answers: Sequence[Answered]) -> np.ndarray:
    """(N, 3) confidence threshold, precision of the answers above it, share of all queries answered correctly above it;
    strictest first."""
    given = sorted((a for a in answers if a.outcome != ABSTAINED), key=lambda a: -a.confidence)
    right = np.cumsum([a.outcome == CORRECT for a in given])
    number = np.arange(1, len(given) + 1)
    return np.column_stack([[a.confidence for a in given], right / number, right / max(len(answers), 1)])


def trial(memory: Memory, queries: Sequence[Query], *, checks: int, seed: int = 0,
          kinds: Sequence[str] = ("votes", "kd_tree", "vlad")) -> dict[str, list[Answered]]:
    """Method -> answers: ways of retrieval, each alone and followed by the check with a second look at SECOND_LOOK
    candidates."""
    out: dict[str, list[Answered]] = {}
    for kind in kinds:
        database = PlaceDatabase(memory, PlaceSettings(kind, checks, rules=RULES), np.random.default_rng(seed))
        assert database.retrieval is not None, "a trial needs stored views"
        out[kind] = named_views(memory, database.retrieval, queries)
        out[f"{kind}+check"] = checked_poses(database, queries)
    return out


def _within(pose_a: np.ndarray, pose_b: np.ndarray, metres: float, degrees: float) -> bool:
    x_m, y_m, yaw_rad = planar(inverse(pose_a) @ pose_b)
    return bool(np.hypot(x_m, y_m) <= metres and abs(wrap(yaw_rad)) <= np.radians(degrees))
