"""Does the map explain the scan: shares by hand, chances that grow with the way and fall where the map is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Motion, Scan, Tracking
from rhs_localisers.advanced import FitSettings, ScanAdvanced
from rhs_localisers.particle_filter import freshness
from rhs_localisers.scan_fit import FitWatch


def room() -> OccupancyGrid:
    """4 m by 4 m, walls one cell thick, one cell of wall at (3.05, 2.05)."""
    cells = np.zeros((40, 40), np.float32)
    cells[[0, -1]] = cells[:, [0, -1]] = 1.0
    cells[20, 30] = 1.0
    return OccupancyGrid(cells, 0.1, (0.0, 0.0))


def scan(*ranges: float) -> Scan:
    """Beams spread over a right angle to the left of ahead."""
    return Scan(np.linspace(0.0, np.pi / 2, len(ranges)), np.array(ranges), 10.0)


def explained(watch: FitWatch, seen: Scan, at: np.ndarray) -> float:
    """What the map explains of one scan from a pose."""
    watch.start()
    watch.see(seen)
    return float(watch.explained(at[None], watch.beams())[0])


def test_ends_on_walls_are_explained_those_in_the_open_and_behind_walls_are_not():
    watch = FitWatch(room(), FitSettings(least_beams=2, slack_cells=2))
    assert explained(watch, scan(1.95, 1.95), np.array([2.0, 2.5, 0.0])) == pytest.approx(0.5, abs=0.01)  # left: too far
    assert explained(watch, scan(1.95, 1.45), np.array([2.0, 2.5, 0.0])) == pytest.approx(1.0)
    assert explained(watch, scan(1.0, 1.0), np.array([2.0, 1.0, 0.0])) < 0.01  # in the open
    assert explained(watch, scan(1.95, 1.9), np.array([2.0, 2.05, 0.0])) == pytest.approx(0.5)  # ahead through the post


def test_ends_where_nothing_is_mapped_say_nothing():
    grid = room()
    cells = grid.probability.copy()
    cells[22:, 15:25] = 0.5  # nobody was there, nor saw the wall behind
    watch_grid = OccupancyGrid(cells, grid.resolution_m, grid.origin_m)
    watch = FitWatch(watch_grid, FitSettings(least_beams=1, mapped=0.5))
    at = np.array([2.0, 2.5, 0.0])
    assert explained(watch, scan(1.95, 1.0), at) == pytest.approx(1.0)  # the wall ahead; to the left an end in the unknown
    assert explained(watch, scan(1.0, 1.0), at) < 0.01  # ahead in the open
    doubting = FitWatch(watch_grid, FitSettings(least_beams=1, mapped=0.6))
    assert explained(doubting, scan(1.95, 1.0), at) == pytest.approx(0.5)  # too many in the unknown: they count


def test_too_few_beams_say_nothing():
    watch = FitWatch(room(), FitSettings())
    watch.see(scan(1.0, np.inf, np.nan))
    watch.look(np.array([2.0, 2.0, 0.0]))
    assert np.isnan(watch.share) and watch.chance == FitSettings().prior and not watch.rivals_due()


AT, WRONG, SEEN = np.array([2.0, 2.5, 0.0]), np.array([2.0, 1.0, 0.0]), scan(1.95, 1.45)


def test_the_margin_over_the_best_rival_weighs_what_was_believed_before():
    watch = FitWatch(room(), FitSettings(least_beams=2, prior=0.2, scale=0.5, first_m=1.0, full_m=8.0))
    watch.see(SEEN)
    assert watch.rivals_due()
    watch.compare(np.array([WRONG, WRONG]))
    assert not watch.rivals_due()
    watch.look(AT)
    margin = watch.share - watch.rival
    assert watch.share == pytest.approx(1.0) and 0.4 < margin < 0.6  # the wall ahead explains one of two beams
    odds = 0.25 * np.exp(margin / 0.5 / 8.0)  # one scan is worth a metre of the eight that count in full
    assert watch.chance == pytest.approx(odds / (1.0 + odds))
    watch.look(AT)
    assert watch.chance == pytest.approx(odds / (1.0 + odds))  # nothing new


def test_a_rival_that_explains_as_much_leaves_a_robot_in_doubt_for_as_long_as_it_does():
    watch = FitWatch(room(), FitSettings(least_beams=2))
    for _ in range(40):
        watch.move(se2(0.0, 0.0, 0.0), 0.5)
        watch.see(SEEN)
        watch.compare(AT[None])
        watch.look(AT)
    assert watch.share == watch.rival and watch.chance == pytest.approx(FitSettings().prior)
    for _ in range(40):
        watch.move(se2(0.0, 0.0, 0.0), 0.5)
        watch.see(SEEN)
        watch.compare(WRONG[None])
        watch.look(AT)
    assert watch.chance > 0.99


def test_rivals_move_as_the_robot_does_and_are_asked_for_again_after_a_metre():
    watch = FitWatch(room(), FitSettings(least_beams=2, rivals_m=1.0))
    watch.see(SEEN)
    watch.compare(np.array([[1.0, 2.5, 0.0]]))
    watch.move(se2(0.9, 0.0, 0.0), 0.9)
    assert not watch.rivals_due()
    watch.move(se2(0.1, 0.0, 0.0), 0.1)
    assert watch.rivals_due()
    watch.see(SEEN)
    watch.look(AT)  # the rival stands there by now
    assert watch.rival == pytest.approx(watch.share)


def test_scans_of_before_are_laid_where_the_odometry_puts_them():
    watch = FitWatch(room(), FitSettings(least_beams=2))
    watch.see(SEEN)
    watch.move(se2(0.5, 0.0, 0.0), 0.5)
    watch.see(scan(1.45, 1.45))
    before, now = [[-0.5, 0, 1.45, 0], [-0.5, 0, -0.5, 1.45]], [[0, 0, 1.45, 0], [0, 0, 0, 1.45]]
    assert watch.beams() == pytest.approx(np.array(before + now))
    watch.start()
    assert len(watch.beams()) == 0


def test_a_belief_that_leaps_off_its_motion_is_another_belief():
    def led(to: np.ndarray) -> float:
        watch = FitWatch(room(), FitSettings(least_beams=2, prior=0.1))
        watch.start(0.99)
        watch.see(SEEN)
        watch.compare(np.array([WRONG]))
        watch.follow(np.array([1.0, 1.0, 0.0]), to)
        watch.look(AT)
        return watch.chance

    assert led(np.array([1.2, 1.0, 0.1])) > 0.99  # near enough
    assert led(np.array([2.0, 1.0, 0.0])) < 0.98


def test_what_is_new_in_a_scan_goes_with_the_way():
    def after(*travel: float) -> float:
        return freshness(Motion(se2(*travel), np.eye(6), Tracking.OK), ScanAdvanced(fresh_m=0.3))

    assert after(0.0, 0.0, 0.0) == 0.0 and after(0.3, 0.0, 0.0) == pytest.approx(1.0) and after(5.0, 0.0, 0.0) == 1.0
    assert after(0.03, 0.0, 0.0) == pytest.approx(0.1) and after(0.0, 0.0, 0.15) == pytest.approx(0.5)
