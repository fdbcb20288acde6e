"""Walls seen all round: the farthest on each bearing, odds by hand, and a robot that nobody carried off knows it again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import SMALL, context, look, ring, survey

from rhs.api.geometry import planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, BeliefStatus, Motion, Scan, Tracking
from rhs.estimation.filters.pose_hypotheses import Hypotheses, Hypothesis, Trust, carried, likelier
from rhs.estimation.scans.rays import cast
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.survey import FURNITURE, at_eye_level
from rhs_localisers.advanced import PanoramaSettings
from rhs_localisers.config import SiftDb
from rhs_localisers.panorama import LookRound, Panorama, Whereabouts

USUAL = PanoramaSettings()
VIEW = np.radians(np.linspace(-30.0, 30.0, 61))


def room(*, post: bool) -> OccupancyGrid:
    """6 m by 6 m, walls one cell thick, unknown outside; post: a wall from the left into the room at y = 4 m."""
    cells = np.full((62, 62), 0.02, np.float32)
    cells[[0, -1]] = cells[:, [0, -1]] = 0.98
    if post:
        cells[40, :30] = 0.98
    return OccupancyGrid(cells, 0.1, (-0.1, -0.1))


def seen(grid: OccupancyGrid, pose: np.ndarray, bearings: np.ndarray = VIEW) -> Scan:
    return Scan(bearings, cast(grid.occupied(), grid, pose[:2], bearings + pose[2], 9.0), 9.0)


def all_round(grid: OccupancyGrid, pose: np.ndarray) -> Scan:
    return seen(grid, pose, np.linspace(-np.pi, np.pi, 180, endpoint=False))


def test_of_each_bearing_the_farthest_counts_so_that_who_walks_by_hides_nothing():
    panorama, free = Panorama(USUAL), np.full(61, 3.0)
    panorama.add(Scan(VIEW, np.where(VIEW > 0.0, 1.0, free), 9.0), np.eye(4))
    panorama.add(Scan(VIEW, np.where(VIEW < 0.0, 1.0, free), 9.0), np.eye(4))
    ranges_m = panorama.scan().ranges_m
    np.testing.assert_allclose(ranges_m[np.isfinite(ranges_m)], 3.0)
    assert panorama.share == pytest.approx(61.0 / 360.0, abs=0.02)
    panorama.add(None, se2(0.0, 0.0, np.pi))
    ahead = np.isfinite(panorama.scan().ranges_m) & (np.abs(panorama.scan().bearings_rad) < np.pi / 2.0)
    assert not ahead.any(), "it has turned round"
    panorama.add(None, se2(USUAL.near_m + 0.1, 0.0, 0.0))
    assert panorama.share == 0.0, "that was seen from elsewhere"


def test_the_odds_of_all_places_are_one_in_the_mean_and_a_right_one_stands_out():
    grid, pose = room(post=True), np.array([1.5, 5.0, 0.4])
    places = Whereabouts(grid, USUAL)
    odds = places.odds(all_round(grid, pose), np.vstack([pose, pose + [2.0, -3.0, 1.0], places._lattice]))
    assert odds[0] > 5.0 and odds[1] < 0.0
    assert np.exp(odds[2:]).mean() == pytest.approx(1.0)
    assert (odds[2:] > 5.0).mean() < np.exp(-5.0), "by Markov's inequality"


def test_a_map_without_free_room_says_nothing():
    walls = OccupancyGrid(np.full((20, 20), 0.98, np.float32), 0.1, (0.0, 0.0))
    odds = Whereabouts(walls, USUAL).odds(all_round(room(post=True), np.ones(3)), np.ones((2, 3)))
    np.testing.assert_array_equal(odds, 0.0)


def test_a_room_that_looks_alike_from_four_sides_says_so():
    grid, places = room(post=False), Whereabouts(room(post=False), USUAL)
    corners = [(2.0, 1.0), (-1.0, 2.0), (-2.0, -1.0), (1.0, -2.0)]
    turned = [np.array([3.0 + x, 3.0 + y, 0.2 + k * np.pi / 2.0]) for k, (x, y) in enumerate(corners)]
    np.testing.assert_allclose(np.ptp(places.odds(all_round(grid, turned[0]), np.array(turned))), 0.0, atol=0.5)


def test_the_map_is_asked_again_when_more_was_seen_and_what_it_said_does_not_count_twice():
    grid, pose = room(post=True), np.array([1.5, 5.0, 0.0])
    round_, turn = LookRound(grid, ScanMatcher(grid), USUAL), se2(0.0, 0.0, np.radians(20.0))
    said = []
    for k in range(18):
        here = pose + [0.0, 0.0, k * np.radians(20.0)]
        due = round_.add(seen(grid, here), turn if k else np.eye(4))
        said += [float(round_.odds([Hypothesis(se2(*here), SMALL, 1.0)])[1][0])] if due else []
    assert 2 <= len(said) <= 4
    whole = Whereabouts(grid, USUAL).odds(all_round(grid, pose), pose[None])[0]
    assert sum(said) == pytest.approx(whole, abs=2.0)


def test_a_guess_too_light_once_carried_off_is_likely_for_the_rule_is_weighed_all_the_same():
    trust = Trust(floor=0.05)
    state = Hypotheses((Hypothesis(se2(1.0, 1.0, 0.0), SMALL, 0.84), Hypothesis(se2(3.0, 1.0, 0.0), SMALL, 0.06)), 0.1)
    assert len(carried(state, 0.5, trust).guesses) == 1
    after = likelier(state, np.log([1.0, 100.0]), trust, elsewhere=0.5)  # 0.84, 6 and 0.9 parts
    assert [g.weight for g in after.guesses] == pytest.approx([6.0 / 7.74, 0.84 / 7.74])
    assert after.elsewhere == pytest.approx(0.9 / 7.74)


def test_things_lower_than_the_camera_are_free_at_its_level():
    cells = np.array([[0.98, FURNITURE, 0.02, np.nan]], np.float32)
    level = at_eye_level(OccupancyGrid(cells, 0.1, (0.0, 0.0)))
    assert level.occupied().tolist() == [[True, False, False, False]]
    assert level.free().tolist() == [[False, True, True, False]]


def told(carried_to: np.ndarray | None, *, people: bool = True) -> list[Belief]:
    """A robot among bare walls, with a post, turns once round after somebody stood before it; meanwhile nobody carried it
    off, or to another pose (3,). people: somebody was to be seen before, too."""
    grid, here = room(post=True), np.array([1.5, 5.0, 0.0])
    part = SiftDb().build(context())
    part.learn(survey(ring(24)), grid)
    part.start(Belief(se2(*here), SMALL))
    beliefs, view, coat = [], look(se2(0.0, 0.0, 0.0)), look(se2(-1.4, 0.0, 4.6))
    bare = replace(view, image=np.full_like(view.image, 128))
    for k in range(40):
        step = se2(0.0, 0.0, np.radians(12.0)) if k > 2 else np.eye(4)
        here = planar(se2(*here) @ step) if k != 2 or carried_to is None else carried_to
        scan = seen(grid, here) if k != 2 else Scan(VIEW, np.full(61, 0.4), 9.0)
        scan = replace(scan, ranges_m=np.where(VIEW > 0.1, 0.8, scan.ranges_m)) if people and k < 2 else scan
        shown = view if k < 2 else coat if k == 2 else bare
        status = Tracking.LOST if k == 2 else Tracking.OK
        beliefs.append(part.update(replace(shown, index=k, scan=scan), Motion(step, SMALL, status)))
    return beliefs


@pytest.mark.parametrize("carried_to", [None, np.array([4.5, 1.5, 1.0])])
def test_walls_all_round_say_that_nobody_was_carried_off_and_never_that_who_was_was_not(carried_to):
    beliefs = told(carried_to)
    sure = [belief.status is BeliefStatus.TRACKING for belief in beliefs]
    assert sure[0] and not sure[3], "the view broke off"
    assert sure[-1] == (carried_to is None)


def test_where_nobody_was_to_be_seen_walls_are_not_asked():
    assert told(None, people=False)[-1].status is not BeliefStatus.TRACKING
