"""What a belief errs by with its map: carried along by odometry, taken away by what is recognised, said in the status."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import SMALL, context, look, ring, survey

from rhs.api.geometry import inverse, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Tracking
from rhs.estimation.filters.pose_hypotheses import Hypothesis
from rhs_localisers.config import ParticleFilter, SiftDb
from rhs_localisers.map_spread import MapSpread
from rhs_localisers.odometry_only import OdometryOnly

SURE, WIDE = np.diag([1e-4] * 3 + [1e-6] * 3), np.diag([0.3**2] * 3 + [np.radians(2.0) ** 2] * 3)


def _bent():
    """A map begun at the origin, 10 m and back: its last views, beside the first, may lie 0.3 m off."""
    first, middle, last = survey(ring(24))[:3]
    return [replace(first, map_from_body=se2(0, 0, 0), of_map=SURE), replace(middle, map_from_body=se2(10, 0, np.pi)),
            replace(last, map_from_body=se2(0.5, 0, np.pi), of_map=WIDE)]


def _sigma_m(spread):
    return np.sqrt(np.diag(spread.covariance)[:2])


def test_a_robot_goes_on_to_err_as_the_view_did_in_which_the_survey_ended():
    """Also beside its start, which it has not recognised: 0.3 m, and two degrees of heading make 0.17 m more after 5 m."""
    spread = MapSpread(_bent())
    spread.begin(se2(0.5, 0, np.pi))
    spread.move(se2(5.0, 0.0, 0.0))
    assert _sigma_m(spread) == pytest.approx([0.3, np.hypot(0.3, 5.0 * np.radians(2.0))])


@pytest.mark.parametrize(("along", "across"), [(1.0, 1.0), (1e-4, 1e-4), (1.0, 1e-4)])
def test_what_was_recognised_takes_it_away_in_the_directions_that_were_seen(along, across):
    """Variances that a fix leaves: all, hardly any, and none across a plain corridor."""
    spread, pose = MapSpread(_bent()), se2(0.0, 0.0, 0.0)
    spread.begin(se2(0.5, 0, np.pi))
    before = Hypothesis(pose, 0.01 * np.eye(6), 1.0)
    spread.follow(before, Hypothesis(pose, np.diag([0.01 * along, 0.01 * across, 0.01, 0.01, 0.01, 0.01]), 1.0))
    assert _sigma_m(spread) == pytest.approx([0.3 if left == 1.0 else 0.01 for left in (along, across)], rel=0.1)


def test_another_guess_errs_as_the_map_does_where_it_stands():
    spread = MapSpread(_bent())
    spread.begin(se2(0.5, 0, np.pi))
    spread.follow(Hypothesis(se2(0.4, 0, 0), SURE, 1.0), Hypothesis(se2(0, 0, 0), 4.0 * SURE, 1.0))
    assert _sigma_m(spread) == pytest.approx([0.01, 0.01])


@pytest.mark.parametrize(("of_map", "status"), [(None, BeliefStatus.TRACKING), (SURE, BeliefStatus.TRACKING),
                                                (WIDE, BeliefStatus.DEGRADED)])
def test_a_localiser_that_knows_its_place_on_a_bent_map_is_not_sure_of_the_place(of_map, status):
    path = [se2(1.4 * np.cos(a), 1.4 * np.sin(a), a + 1.5) for a in np.linspace(0.1, 0.7, 4)]
    part = SiftDb(every=1).build(context())
    part.learn([replace(view, of_map=of_map) for view in survey(ring(24))], None)
    part.start(Belief(path[0], SMALL))
    for before, pose in zip([path[0], *path], path, strict=False):
        belief = part.update(look(pose), Motion(inverse(before) @ pose, SMALL, Tracking.OK))
    assert belief.status is status and np.linalg.norm((inverse(path[-1]) @ belief.map_from_body)[:3, 3]) < 0.05
    assert (belief.probability > 0.9) == (status is BeliefStatus.TRACKING)


@pytest.mark.parametrize("settings", [ParticleFilter(), OdometryOnly()])
def test_every_localiser_is_as_unsure_as_its_map(settings):
    """Of the same belief on a map that is sure, and on one that may lie 0.3 m off."""
    pose, grid = se2(1.4, 0.0, 1.5), OccupancyGrid(np.zeros((60, 60), np.float32), 0.1, (-3.0, -3.0))
    beliefs = []
    for of_map in (SURE, WIDE):
        part = settings.build(context())
        part.learn([replace(view, of_map=of_map) for view in survey(ring(24))], grid)
        part.start(Belief(pose, SMALL))
        beliefs.append(part.update(look(pose), Motion(np.eye(4), SMALL, Tracking.OK)))
    sure, unsure = beliefs
    assert sure.status is BeliefStatus.TRACKING and unsure.status is BeliefStatus.DEGRADED
    np.testing.assert_allclose(unsure.map_from_body, sure.map_from_body, atol=0.02)
    assert unsure.covariance[0, 0] == pytest.approx(sure.covariance[0, 0] + 0.09, abs=0.005)
    assert unsure.probability < 0.4 < 0.9 < sure.probability
