"""What several benchmarks need: tables of rows, and a part for the word that names it."""

from __future__ import annotations

import csv
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import orthonormal
from rhs.api.records import Motion, Observation
from rhs.config import registry


def write(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """A CSV table with four figures of every float; the columns are those of the first row."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()} for row in rows)


def odometry(word: str, context: Context) -> Any:
    """The part for `name:key=value,key=value`."""
    name, _, overrides = word.partition(":")
    cls = registry.load("odometry", name)
    values: dict[str, Any] = {}
    for item in filter(None, overrides.split(",")):
        key, _, text = item.partition("=")
        kind = type(getattr(cls(), key))
        values[key] = text in ("true", "True") if kind is bool else kind(text)
    return cls(**values).build(context)


def follow(
    part: Any, views: Sequence[Observation], start: np.ndarray
) -> tuple[np.ndarray, list[Motion], list[float]]:
    """Poses (N, 4, 4) from `start` on, motions, and CPU seconds of each view, of an odometry shown these views."""
    pose, poses, motions, seconds = start, [], [], []
    for number, view in enumerate(views):
        begin = time.process_time()
        motion = part.update(view)
        seconds.append(time.process_time() - begin)
        pose = orthonormal(pose @ motion.previous_from_body) if number else pose
        poses.append(pose)
        motions.append(motion)
    return np.array(poses), motions, seconds
