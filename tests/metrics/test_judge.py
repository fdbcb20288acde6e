"""The judge: exact answers that can be worked out by hand, and against exact rational arithmetic on random grids."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from rhs.metrics.path_judge import Optimum, path_valid, polyline_length, shortest_length_m


def grid(*rows: str) -> np.ndarray:
    """Blocked cells from text, '#' blocked, first line is the highest y."""
    return np.array([[c == "#" for c in row] for row in rows[::-1]])


def enters(p, q, i, j) -> bool:
    """Exactly: does the open segment p q meet the open unit cell (i, j)? (Liang-Barsky in rationals)"""
    low, high = Fraction(0), Fraction(1)
    for a, b, edge in ((p[0], q[0], i), (p[1], q[1], j)):
        d = b - a
        if d == 0:
            if not edge < a < edge + 1:
                return False
            continue
        t0, t1 = sorted(((edge - a) / d, (edge + 1 - a) / d))
        low, high = max(low, t0), min(high, t1)
    return low < high


def test_straight_line_through_a_block_is_invalid_and_round_it_valid():
    blocked = grid("....", ".##.", ".##.", "....")
    assert not path_valid([(0.5, 0.5), (3.5, 3.5)], blocked, 1.0, (0, 0))
    assert path_valid([(0.5, 0.5), (0.5, 3.5), (3.5, 3.5)], blocked, 1.0, (0, 0))


def test_touching_a_corner_is_allowed_squeezing_between_two_is_not():
    one = grid("..#", "...", "...")
    assert path_valid([(0.5, 0.5), (2.0, 2.0)], one, 1.0, (0, 0))
    assert path_valid([(1.0, 3.0), (2.0, 2.0), (3.0, 1.0)], one, 1.0, (0, 0))
    pinch = grid("#.", ".#")
    assert not path_valid([(0.5, 0.5), (1.5, 1.5)], pinch, 1.0, (0, 0))
    assert not path_valid([(0.5, 0.5), (1.0, 1.0), (1.5, 1.5)], pinch, 1.0, (0, 0))


def test_the_seam_between_two_blocked_cells_is_closed():
    wall = grid(".#.", ".#.", "...")
    assert not path_valid([(0.5, 2.0), (2.5, 2.0)], wall, 1.0, (0, 0))
    assert path_valid([(1.0, 0.5), (1.0, 2.9)], wall, 1.0, (0, 0))  # along the side of the wall


def test_outside_nan_and_empty_are_invalid():
    free = np.zeros((3, 3), bool)
    assert path_valid([(0.0, 0.0), (3.0, 3.0)], free, 1.0, (0, 0))
    assert not path_valid([(0.5, 0.5), (3.5, 0.5)], free, 1.0, (0, 0))
    assert not path_valid([(0.5, 0.5), (np.nan, 1.0)], free, 1.0, (0, 0))
    assert not path_valid([], free, 1.0, (0, 0))


def test_random_segments_agree_with_rational_arithmetic():
    rng = np.random.default_rng(4)
    blocked = rng.random((9, 9)) < 0.25
    disagreements, seen = 0, {True: 0, False: 0}
    for _ in range(1500):
        p, q = np.round(rng.uniform(0, 9, (2, 2)), 2)
        exact = [tuple(Fraction(str(v)) for v in point) for point in (p, q)]
        truth = not any(enters(*exact, i, j) for j, i in np.argwhere(blocked))
        ends_free = all(not blocked[min(int(y), 8), min(int(x), 8)] for x, y in (p, q))
        if not ends_free:
            truth = False
        seen[truth] += 1
        disagreements += path_valid([p, q], blocked, 1.0, (0, 0)) != truth
    assert disagreements == 0 and min(seen.values()) > 200


def test_shortest_path_round_a_block_by_hand():
    """From (0.5, 2) to (4.5, 2) round the block [1, 4] x [1, 3]: over two of its corners, 3 + 2 sqrt(0.25 + 1)."""
    blocked = grid(".....", ".###.", ".###.", ".....")
    expected = 3.0 + 2.0 * np.hypot(0.5, 1.0)
    assert shortest_length_m(blocked, 1.0, (0, 0), [(0.5, 2.0), (4.5, 2.0)]) == pytest.approx(expected, abs=1e-12)
    assert shortest_length_m(blocked, 0.1, (-3, 7), [(-2.95, 7.2), (-2.55, 7.2)]) == pytest.approx(0.1 * expected)


def test_no_way_is_nan_and_legs_add_up():
    wall = grid(".#.", ".#.", ".#.")
    assert np.isnan(shortest_length_m(wall, 1.0, (0, 0), [(0.5, 0.5), (2.5, 0.5)]))
    free = np.zeros((5, 5), bool)
    assert shortest_length_m(free, 1.0, (0, 0), [(1, 1), (4, 1), (4, 3)]) == pytest.approx(5.0)


def test_optimum_equals_brute_force_over_all_lattice_points():
    """Every shortest path bends at lattice points only, so Dijkstra over all pairs in sight must agree."""
    from scipy.sparse.csgraph import dijkstra

    for seed in range(6):
        rng = np.random.default_rng(seed)
        blocked = rng.random((7, 7)) < 0.3
        blocked[0, 0] = blocked[6, 6] = False
        ends = [(0.5, 0.5), (6.5, 6.5)]
        nodes = ends + [(x, y) for x in range(8) for y in range(8)]
        weights = np.zeros((len(nodes), len(nodes)))
        for a, b in combinations(range(len(nodes)), 2):
            if path_valid([nodes[a], nodes[b]], blocked, 1.0, (0, 0)):
                weights[a, b] = np.hypot(*np.subtract(nodes[a], nodes[b]))
        # a bend in a pinch is not a way: drop lattice points between two diagonal blocked cells
        framed = np.pad(blocked, 1, constant_values=True)
        for k, (x, y) in enumerate(nodes[2:], 2):
            sw, se, nw, ne = framed[y, x], framed[y, x + 1], framed[y + 1, x], framed[y + 1, x + 1]
            if (sw and ne and not se and not nw) or (se and nw and not sw and not ne):
                weights[k] = weights[:, k] = 0.0
        best = dijkstra(weights, directed=False, indices=0)[1]
        found = shortest_length_m(blocked, 1.0, (0, 0), ends)
        assert found == pytest.approx(best, abs=1e-9) if np.isfinite(best) else np.isnan(found)


def test_the_optimum_is_itself_valid():
    rng = np.random.default_rng(8)
    blocked = rng.random((60, 60)) < 0.15
    optimum = Optimum(blocked, 0.1, (0, 0))
    free = np.argwhere(~blocked)
    found = 0
    for _ in range(20):
        (r0, c0), (r1, c1) = free[rng.integers(len(free), size=2)]
        path = optimum.path_m(((c0 + 0.5) * 0.1, (r0 + 0.5) * 0.1), ((c1 + 0.5) * 0.1, (r1 + 0.5) * 0.1))
        if len(path):
            found += 1
            assert path_valid(path, blocked, 0.1, (0, 0))
            assert polyline_length(path) >= np.hypot(r1 - r0, c1 - c0) * 0.1 - 1e-9
    assert found > 10
