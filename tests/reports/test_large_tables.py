"""Tables of large sweeps: read by columns and kept as Parquet, they are what reading row by row gives."""

from __future__ import annotations

import pandas as pd
import pytest

from rhs.reports import cache
from rhs.reports.intervals import median_text
from rhs.reports.observations import independent
from rhs.reports.summary import summarise
from rhs.reports.table import _row_by_row, rows, to_csv
from rhs.runfolder.shards import Line, Shard, shards

pytest.importorskip("pyarrow")


def write(sweep, count, **columns):
    """A sweep of planning rows; columns: more of them, as functions of the seed."""
    (sweep / "sweep.json").write_text("{}")
    shard = Shard(sweep)
    for seed in range(count):
        row = {"status": "ok", "reason": "", "success": 1.0, "task": "planning", "world": "map1", "planner": "ab"[seed % 2],
               "seed": seed // 4, "config_hash": f"{(7 * seed) % count:010x}", "plan_steps": 20.0 + seed,
               "plan_length_m": None if seed % 3 else 1.0 / (seed + 1), "plan_ms": 1.0, "far": float("inf"), "flag": True,
               **{name: value(seed) for name, value in columns.items()}}
        shard.add(Line(f"seed={seed}", f"{seed:012x}", {"planner.samples": seed % 5} if seed % 2 else {}, row).text())
    shard.close()


@pytest.fixture(autouse=True)
def small_is_large(monkeypatch):
    monkeypatch.setattr(cache, "FROM_ROWS", 10)


def test_columns_and_parquet_are_what_row_by_row_gives(tmp_path):
    write(tmp_path, 60)
    expected = _row_by_row([tmp_path], [])
    first, second = rows([tmp_path]), rows([tmp_path])
    assert len(list((tmp_path / "rows").glob("table-*.parquet"))) == 1
    pd.testing.assert_frame_equal(first, expected)
    pd.testing.assert_frame_equal(second, expected)
    assert to_csv(second) == to_csv(expected)
    assert summarise(second).equals(summarise(expected))


@pytest.mark.parametrize("mixed", [lambda seed: "x" if seed == 3 else 1.0, lambda seed: "2026-11-22T10:00:00"])
def test_what_is_not_plain_is_read_row_by_row(tmp_path, mixed):
    write(tmp_path, 40, odd=mixed)
    complaints: list[str] = []
    expected = _row_by_row([tmp_path], complaints)
    found: list[str] = []
    pd.testing.assert_frame_equal(rows([tmp_path], unreadable=found), expected)
    assert found == complaints


def test_a_torn_line_is_told_of_from_parquet_too(tmp_path):
    write(tmp_path, 40)
    with shards(tmp_path)[0].open("ab") as file:
        file.write(b"0000")
    for _ in range(2):
        found: list[str] = []
        assert len(rows([tmp_path], unreadable=found)) == 40
        assert len(found) == 1 and "1 line is torn" in found[0]


def test_a_row_more_is_seen_though_a_table_was_kept(tmp_path):
    write(tmp_path, 20)
    assert len(rows([tmp_path])) == 20
    more = Shard(tmp_path)
    more.add(Line("seed=x", "f" * 12, {}, {"status": "ok", "world": "map1", "seed": 99, "config_hash": "x"}).text())
    more.close()
    assert len(rows([tmp_path])) == 21


def test_more_runs_than_a_power_of_two_has_room_for_have_a_median():
    assert median_text([float(k) for k in range(3001)]) == "1500 [1446, 1554]"


def test_a_configuration_whose_rows_are_equal_for_every_seed_counts_once():
    table = pd.DataFrame({"task": "planning", "planner": ["a", "a", "b", "b"], "seed": [0, 1, 0, 1],
                          "wall_ms": [1.0, 2.0, 3.0, 4.0], "plan_length_m": [1.0, 1.0, None, 2.0]})
    assert list(independent(table)) == [0, 0, 2, 3]
