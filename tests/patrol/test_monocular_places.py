"""Places and loops with one camera on its own: key-points lifted on walls a little wrong, views without any depth."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import CAMERA, FEATURES, context, look, ring, survey

from rhs.api.geometry import inverse, log_se3, planar, se2
from rhs.api.records import Features, View, Wall
from rhs.estimation.scans.wall_rays import lift_on_walls
from rhs.estimation.views.features import features
from rhs.estimation.views.place_database import PlaceDatabase, PlaceSettings
from rhs.estimation.views.place_memory import memory_of
from rhs.testing.room import HIGH, LOW
from rhs_loop_closers.config import ErrorDistribution, PoseGraph

WRONG_M = 0.03  # each wall stands so far outside its true place, as an odometry of one camera might have it
TRUTH = ring(24)


def walls() -> tuple[Wall, ...]:
    (x0, y0, _), (x1, y1, top) = LOW - WRONG_M, HIGH + WRONG_M
    corners = [np.array(c) for c in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    return tuple(Wall(corners[k], corners[(k + 1) % 4], 0.0, float(top)) for k in range(4))


def flat(seen: Features) -> Features:
    return Features(seen.pixels, seen.descriptors, np.full_like(seen.points, np.nan))


def one_eyed(views: list[View], truth: list[np.ndarray]) -> list[View]:
    """The views with depths from the walls alone."""
    return [view if view.features is None else
            replace(view, features=lift_on_walls(flat(view.features), CAMERA, pose, walls()))
            for view, pose in zip(views, truth, strict=True)]


@pytest.fixture(scope="module")
def database() -> PlaceDatabase:
    return PlaceDatabase(memory_of(one_eyed(survey(TRUTH), TRUTH)), PlaceSettings(), np.random.default_rng(0))


def test_a_view_without_depth_is_located_by_points_on_walls(database):
    """Twelve views up to 0.2 m and 8 degrees off the ring. Walls 3 cm wrong at 2 to 4 m: a pose wrong by centimetres, and a
    covariance that says about so much (of x, y, yaw: chi-square with three degrees of freedom, median 2.4)."""
    rng, surprise = np.random.default_rng(5), []
    for k in range(0, 24, 2):
        pose = TRUTH[k] @ se2(rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), rng.uniform(-0.14, 0.14))
        answer = database.ask(flat(features(look(pose), FEATURES)), CAMERA)
        assert answer.best is not None, answer.reason
        gap = log_se3(inverse(pose) @ answer.best.map_from_body)
        assert np.linalg.norm(gap[:2]) < 0.10 and np.degrees(abs(gap[5])) < 1.5
        keep = np.ix_([0, 1, 5], [0, 1, 5])
        surprise.append(gap[[0, 1, 5]] @ np.linalg.solve(answer.best.covariance[keep], gap[[0, 1, 5]]))
    assert np.median(surprise) < 6.0


def test_without_walls_one_eye_knows_no_metres():
    views = [replace(view, features=flat(view.features)) for view in survey(TRUTH)]
    database = PlaceDatabase(memory_of(views), PlaceSettings(), np.random.default_rng(0))
    answer = database.ask(flat(features(look(TRUTH[3]), FEATURES)), CAMERA)
    assert answer.abstained and answer.reason == "no candidate passed the geometric check"


@pytest.mark.parametrize("closer", [ErrorDistribution(), PoseGraph()])
def test_a_lap_is_closed_by_points_on_walls(closer):
    """The lap ends a quarter of a metre off; the first view seen again, by pixels and points on walls, takes 70 % of it."""
    views = one_eyed(survey(TRUTH, drift=se2(0.01, 0.004, 0.01)), TRUTH)
    for k, view in enumerate(views):  # an odometry that drifts knows that it does
        views[k] = replace(view, covariance=np.diag([1e-3 * (k + 1)] * 3 + [1e-3 * (k + 1)] * 3))
    before = np.linalg.norm(planar(inverse(TRUTH[-1]) @ views[-1].map_from_body)[:2])
    closure = closer.build(context()).close(views)
    after = np.linalg.norm(planar(inverse(TRUTH[-1]) @ closure.poses[-1])[:2])
    assert any(edge.accepted for edge in closure.edges)
    assert before > 0.2 and after < 0.3 * before
