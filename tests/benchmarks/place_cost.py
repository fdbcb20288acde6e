"""What a place query costs as the memory grows: retrieval alone, CPU milliseconds, on random descriptors.

    python tests/benchmarks/place_cost.py --keypoints 100

Random descriptors are the worst case for a kd-tree. Writes results/tables/place_cost.csv.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from rhs.estimation.views.retrieval import make_retrieval

TABLE = Path(__file__).resolve().parents[2] / "results" / "tables" / "place_cost.csv"
SIZES = {"votes": (100, 1000), "kd_tree": (100, 1000), "vlad": (100, 1000, 10_000)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keypoints", type=int, default=100)
    keypoints = parser.parse_args().keypoints
    lines = ["retrieval,views,keypoints_per_view,learn_s,query_ms,found\n"]
    for kind, sizes in SIZES.items():
        for views in sizes:
            lines.append(measured(kind, views, keypoints))
            sys.stdout.write(lines[-1])
    TABLE.write_text("".join(lines))
    return 0


def measured(kind: str, views: int, keypoints: int, queries: int = 5) -> str:
    """One row: the queries are stored views with noise, so `found` should be 1."""
    rng = np.random.default_rng(0)
    rows = unit(np.abs(rng.standard_normal((views * keypoints, 128), dtype=np.float32)))
    starts = np.arange(views + 1) * keypoints
    begin = time.process_time()
    retrieval = make_retrieval(kind, rows, starts, rng)
    learn_s = time.process_time() - begin
    retrieval.rank(rows[:keypoints], 1)  # what is compiled at the first call is not the cost of a query
    spent, found = 0.0, 0
    for view in np.linspace(0, views - 1, queries).astype(int):
        own = rows[starts[view]:starts[view + 1]]
        query = unit(own + 0.02 * rng.standard_normal(own.shape, dtype=np.float32))
        begin = time.process_time()
        ranked, _ = retrieval.rank(query, 1)
        spent += time.process_time() - begin
        found += int(ranked[0] == view)
    return f"{kind},{views},{keypoints},{learn_s:.2f},{1e3 * spent / queries:.1f},{found / queries:.2f}\n"


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


if __name__ == "__main__":
    sys.exit(main())
