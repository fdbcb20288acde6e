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


def test_ends_on_walls_are_explained_those_in_the_open_and_behind_walls_are_not():
    watch = FitWatch(room(), FitSettings(least_beams=2))
    assert watch.explained(scan(1.95, 1.95), np.array([2.0, 2.5, 0.0])) == 0.5  # ahead the wall, to the left 0.5 m too far
    assert watch.explained(scan(1.95, 1.45), np.array([2.0, 2.5, 0.0])) == 1.0
    assert watch.explained(scan(1.0, 1.0), np.array([2.0, 1.0, 0.0])) == 0.0  # in the open
    assert watch.explained(scan(1.95, 1.9), np.array([2.0, 2.05, 0.0])) == 0.5  # ahead through the post at 3.05 m


def test_ends_where_nothing_is_mapped_say_nothing():
    grid = room()
    cells = grid.probability.copy()
    cells[22:, 15:25] = 0.5  # nobody was there, nor saw the wall behind
    watch_grid = OccupancyGrid(cells, grid.resolution_m, grid.origin_m)
    watch = FitWatch(watch_grid, FitSettings(least_beams=1, mapped=0.5))
    at = np.array([2.0, 2.5, 0.0])
    assert watch.explained(scan(1.95, 1.0), at) == 1.0  # the wall ahead; to the left an end in the unknown
    assert watch.explained(scan(1.0, 1.0), at) == 0.0  # ahead in the open
    doubting = FitWatch(watch_grid, FitSettings(least_beams=1, mapped=0.6))
    assert doubting.explained(scan(1.95, 1.0), at) == 0.5  # too many in the unknown: they count


def test_too_few_beams_say_nothing():
    watch = FitWatch(room(), FitSettings())
    before = watch.chance
    watch.look(scan(1.0, np.inf, np.nan), np.array([2.0, 2.0, 0.0]), 1.0)
    assert np.isnan(watch.share) and watch.chance == before == pytest.approx(FitSettings().prior)
    assert np.isnan(watch.explained(None, np.zeros(3)))


def test_the_chance_grows_with_new_scans_that_fit_and_falls_with_others():
    watch = FitWatch(room(), FitSettings(least_beams=2, prior=0.1))
    fits, fits_not, at = scan(1.95, 1.45), scan(1.0, 1.0), np.array([2.0, 2.5, 0.0])
    watch.look(fits, at, 0.0)
    assert watch.chance == pytest.approx(0.1)  # nothing new
    watch.look(fits, at, 1.0)
    assert watch.chance == pytest.approx(1.0 / (1.0 + 9.0 * np.exp(-1.4)))  # odds 1:9, and 4 * (1 - 0.65)
    for _ in range(20):
        watch.look(fits, at, 1.0)
    assert watch.chance == pytest.approx(0.9995)
    for _ in range(20):
        watch.look(fits_not, at, 1.0)
    assert watch.chance == pytest.approx(0.0005)


def test_a_belief_that_leaps_off_its_motion_begins_anew():
    watch = FitWatch(room(), FitSettings(prior=0.1))
    watch.begin(0.99)
    watch.follow(np.array([1.0, 1.0, 0.0]), np.array([1.2, 1.0, 0.1]), 0.1)
    assert watch.chance == pytest.approx(0.99)
    watch.follow(np.array([1.0, 1.0, 0.0]), np.array([2.0, 1.0, 0.0]), 0.1)
    assert watch.chance == pytest.approx(0.1)


def test_a_belief_that_stays_behind_its_motion_is_not_trusted_until_it_follows_again():
    watch = FitWatch(room(), FitSettings(prior=0.1, slip_m=0.5, slip_over_m=3.0, least_beams=2))
    watch.begin(0.99)
    for _ in range(20):  # 0.2 m behind in 2 m
        watch.follow(np.array([1.1, 1.0, 0.0]), np.array([1.09, 1.0, 0.0]), 0.1)
    assert watch.chance == pytest.approx(0.99)
    for _ in range(20):  # 0.6 m more in 2 m
        watch.follow(np.array([1.1, 1.0, 0.0]), np.array([1.07, 1.0, 0.0]), 0.1)
    assert watch.chance == pytest.approx(0.1)
    at, seen = np.array([2.0, 2.5, 0.0]), scan(1.95, 1.45)
    for _ in range(40):  # 4 m as it moved: forgotten, and the walls count again
        watch.follow(np.array([1.1, 1.0, 0.0]), np.array([1.1, 1.0, 0.0]), 0.1)
    for _ in range(10):
        watch.look(seen, at, 1.0)
        watch.follow(np.array([1.1, 1.0, 0.0]), np.array([1.1, 1.0, 0.0]), 0.1)
    assert watch.chance > 0.9


def test_a_rival_that_explains_as_much_takes_the_worth_of_a_scan():
    watch = FitWatch(room(), FitSettings(least_beams=2, prior=0.2, expected=0.7, rival_weight=0.5, slope=2.0, rivals_m=1.0))
    at, twin, wrong, seen = (2.0, 2.5, 0.0), (2.0, 2.5, 0.0), (2.0, 1.0, 0.0), scan(1.95, 1.45)
    assert watch.rivals_due(0.0)  # none is known yet
    watch.compare(seen, np.array([twin, wrong]))
    assert watch.rival == 1.0 and not watch.rivals_due(0.9) and watch.rivals_due(0.1)
    watch.look(seen, np.array(at), 1.0)
    assert watch.chance == pytest.approx(1.0 / (1.0 + 4.0 * np.exp(-2.0 * (1.0 - 0.85))))  # expected: (0.7 + 1) / 2
    watch.start()
    assert np.isnan(watch.rival) and watch.rivals_due(0.0)  # a new start knows no rival
    alone = FitWatch(room(), FitSettings(least_beams=2, prior=0.2, expected=0.7, rival_weight=0.5, slope=2.0))
    alone.compare(seen, np.empty((0, 3)))
    alone.look(seen, np.array(at), 1.0)
    assert alone.chance == pytest.approx(1.0 / (1.0 + 4.0 * np.exp(-2.0 * (1.0 - 0.7))))


def test_what_is_new_in_a_scan_goes_with_the_way():
    def after(*travel: float) -> float:
        return freshness(Motion(se2(*travel), np.eye(6), Tracking.OK), ScanAdvanced(fresh_m=0.3))

    assert after(0.0, 0.0, 0.0) == 0.0 and after(0.3, 0.0, 0.0) == pytest.approx(1.0) and after(5.0, 0.0, 0.0) == 1.0
    assert after(0.03, 0.0, 0.0) == pytest.approx(0.1) and after(0.0, 0.0, 0.15) == pytest.approx(0.5)
