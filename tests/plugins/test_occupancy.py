"""The occupancy mapper against the thesis's equations and against rooms one can draw by hand."""

import time
from dataclasses import replace

import numpy as np
import pytest

from rhs.api.contracts import WorldFacts
from rhs.api.errors import ConfigError
from rhs.api.geometry import se2
from rhs.api.records import Scan
from rhs.api.settings import make
from rhs_mappers.occupancy import OccupancyMapper
from rhs_mappers.occupancy_config import Occupancy

BOUNDS_M = (0.0, 0.0, 4.0, 2.0)


def _scan(bearings_rad, ranges_m, max_range_m=10.0, origin_xy_m=(0.0, 0.0)):
    return Scan(np.asarray(bearings_rad, float), np.asarray(ranges_m, float), max_range_m, origin_xy_m)


def _value(mapper, x_m, y_m):
    grid = mapper.grid()
    row, column = grid.cells(np.array([[x_m, y_m]]))[0]
    return float(grid.probability[row, column])


def _thesis(p, hit, true_hit, false_alarm):
    """Eqs 3.8-3.13, literally."""
    occupied = (true_hit if hit else 1 - true_hit) * p
    free = (false_alarm if hit else 1 - false_alarm) * (1 - p)
    return occupied / (occupied + free)


def test_log_odds_equal_the_thesis_update_over_random_histories():
    rng = np.random.default_rng(0)
    for true_hit, false_alarm in [(0.8, 0.1), (0.6, 0.4), (0.95, 0.02)]:
        settings = Occupancy(true_hit=true_hit, false_alarm=false_alarm, belief_bound=0.999999)
        mapper = OccupancyMapper(settings, BOUNDS_M)
        p = 0.5
        for _ in range(10):
            hit = bool(rng.random() < 0.5)
            mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [2.0 if hit else 3.0]))
            p = _thesis(p, hit, true_hit, false_alarm)
            assert _value(mapper, 2.5, 1.0) == pytest.approx(p, rel=1e-4)


def test_one_beam_frees_its_way_hits_its_end_and_leaves_the_rest_unknown():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [2.0]))
    probability = mapper.grid().probability
    row = probability[mapper.grid().cells(np.array([[0.5, 1.0]]))[0, 0]]
    assert (row < 0.25).sum() == 20  # cells centred 0.5 ... 2.4
    assert (row > 0.65).sum() == 1
    assert np.isfinite(probability).sum() == 21


def test_a_beam_that_meets_nothing_frees_up_to_the_range_and_hits_nothing():
    mapper = OccupancyMapper(Occupancy(range_max_m=2.0), BOUNDS_M)
    mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0, 0.5, 1.0], [np.inf, np.nan, 5.0]))
    probability = mapper.grid().probability
    assert np.nanmax(probability) < 0.5
    assert _value(mapper, 2.4, 1.0) < 0.25
    assert np.isnan(_value(mapper, 2.7, 1.0))


def test_many_beams_in_one_cell_count_once_per_scan_and_a_hit_wins():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    fan = np.linspace(-0.01, 0.01, 50)
    ranges = np.where(np.arange(50) == 25, 2.0, 3.0)  # one beam stops where the others pass
    mapper.update(se2(0.5, 1.0, 0.0), _scan(fan, ranges))
    assert _value(mapper, 2.5, 1.0) == pytest.approx(0.8 / 0.9, rel=1e-5)
    assert _value(mapper, 1.0, 1.0) == pytest.approx(0.2 / 1.1, rel=1e-5)


def test_beliefs_are_clamped_so_that_a_wall_can_be_taken_away():
    mapper = OccupancyMapper(Occupancy(belief_bound=0.99), BOUNDS_M)
    for _ in range(200):
        mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [2.0]))
    assert _value(mapper, 2.5, 1.0) == pytest.approx(0.99, abs=1e-6)
    for _ in range(4):
        mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [3.0]))
    assert _value(mapper, 2.5, 1.0) < 0.5


def test_walls_on_the_border_of_the_area_are_drawn_in_one_row_of_cells():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    bearings = np.linspace(-0.6, 0.6, 321) + np.pi / 2
    mapper.update(se2(2.0, 1.0, 0.0), _scan(bearings, 1.0 / np.sin(bearings)))
    occupied = mapper.grid().occupied()
    rows = np.unique(np.nonzero(occupied)[0])
    np.testing.assert_allclose(mapper.grid().centres(np.array([[rows[0], 0]]))[0, 1], 2.0, atol=1e-9)
    assert len(rows) == 1


def test_turning_and_moving_the_robot_moves_the_wall_with_it():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    mapper.update(se2(3.0, 0.5, np.pi / 2), _scan([0.0], [1.0], origin_xy_m=(0.2, 0.0)))
    assert _value(mapper, 3.0, 1.7) > 0.65


def test_a_robot_outside_the_area_does_no_harm_and_draws_what_lies_inside():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    mapper.update(se2(-3.0, 1.0, 0.0), _scan([0.0, np.pi], [4.0, 4.0]))
    assert _value(mapper, 1.0, 1.0) > 0.65
    assert _value(mapper, 0.5, 1.0) < 0.25


def test_reset_forgets():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [2.0]))
    mapper.reset()
    assert np.isnan(mapper.grid().probability).all()


def test_two_mappers_fed_alike_agree_bit_for_bit():
    rng = np.random.default_rng(5)
    scans = [_scan(np.linspace(-0.5, 0.5, 320), rng.uniform(0.5, 3.0, 320)) for _ in range(5)]
    grids = []
    for _ in range(2):
        mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
        for k, scan in enumerate(scans):
            mapper.update(se2(1.0, 1.0, 0.3 * k), scan)
        grids.append(mapper.grid().probability.tobytes())
    assert grids[0] == grids[1]


@pytest.mark.parametrize("wrong", [{"resolution_m": 0.0}, {"true_hit": np.nan}, {"true_hit": 0.3, "false_alarm": 0.4}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=rf"^mapper\.({'|'.join(wrong)})="):
        make(Occupancy, wrong, "mapper")


def test_a_scan_of_320_beams_takes_under_a_millisecond():
    mapper = OccupancyMapper(Occupancy(), (0.0, 0.0, 20.0, 20.0))
    scan = _scan(np.linspace(-0.5, 0.5, 320), np.full(320, 6.9))
    mapper.update(se2(2.0, 10.0, 0.0), scan)
    begin = time.process_time()
    for _ in range(200):
        mapper.update(se2(2.0, 10.0, 0.0), scan)
    assert (time.process_time() - begin) / 200 < 1e-3


def test_a_wall_far_away_is_drawn_and_the_way_to_it_is_not_cleared():
    mapper = OccupancyMapper(Occupancy(range_max_m=30.0, free_max_m=1.0), BOUNDS_M)
    mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0, 0.1], [3.0, np.inf]))
    assert _value(mapper, 3.5, 1.0) > 0.65
    assert _value(mapper, 1.4, 1.0) < 0.35 and np.isnan(_value(mapper, 1.7, 1.0)) and np.isnan(_value(mapper, 3.4, 1.0))
    assert np.isfinite(mapper.grid().probability).sum() < 25  # of the beam that met nothing no more than a metre


def test_a_map_that_grows_along_a_way_is_the_one_that_was_large_enough_from_the_beginning():
    small = OccupancyMapper(Occupancy(), BOUNDS_M, grows=True)
    large = OccupancyMapper(Occupancy(), (-70.0, -30.0, 20.0, 40.0))
    scan = _scan(np.linspace(-np.pi, np.pi, 90, endpoint=False), np.linspace(1.0, 6.0, 90))
    for pose in [(1.0, 1.0, 0.0), (-3.0, 5.0, 0.4), (-30.0, 20.0, 1.0), (-60.0, -20.0, 2.0), (1.5, 1.0, 0.3)]:
        for mapper in (small, large):
            mapper.update(se2(*pose), scan)
    drawn, expected = small.grid(), large.grid()
    known = np.argwhere(np.isfinite(expected.probability))
    same = drawn.cells(expected.centres(known))
    assert drawn.inside(expected.centres(known)).all()
    assert np.array_equal(drawn.probability[tuple(same.T)], expected.probability[tuple(known.T)])
    assert np.isfinite(drawn.probability).sum() == len(known)
    small.reset()
    assert small.grid().shape == (25, 45)


def test_an_odometry_that_flies_away_does_not_take_all_memory():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M, grows=True)
    mapper.update(se2(1e7, 0.0, 0.0), _scan([0.0], [2.0]))
    mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [2.0]))
    assert mapper.grid().shape == (25, 45) and _value(mapper, 2.5, 1.0) > 0.65


def test_an_area_that_is_known_is_not_left():
    mapper = OccupancyMapper(Occupancy(), BOUNDS_M)
    mapper.update(se2(0.5, 1.0, 0.0), _scan([0.0], [6.0]))
    assert mapper.grid().shape == (25, 45)


def test_the_config_builds_from_the_bounds_of_the_world():
    facts = WorldFacts("x", (1.0, 1.0, 0.0), (), BOUNDS_M, 0.3)

    class Stub:
        world = facts

    assert Occupancy().build(Stub()).grid().shape == (25, 45)
    Stub.world = replace(facts, bounds_known=False)
    growing = Occupancy().build(Stub())
    growing.update(se2(30.0, 1.0, 0.0), _scan([0.0], [2.0]))
    assert _value(growing, 32.0, 1.0) > 0.65
