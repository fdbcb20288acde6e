"""The per-step files of a run folder: steps.csv and the trajectories of its phases.

Rows are appended to a partial file as they come, so that a killed run leaves them (`steps.jsonl.tmp-*`); the final
names appear when the table is closed.
"""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from rhs.api.files import free_space, replacing
from rhs.api.geometry import planar
from rhs.api.records import Step
from rhs.api.trajectory import tum_line
from rhs.base.errors import RhsError

PARTIAL = "steps.jsonl.tmp-"  # and the number of the process
LONGEST_TEXT = 1000  # characters of a reason in a cell
COLUMNS = (
    "index", "phase", "stamp_s", "mission", "event", "motion_status", "motion_reason", "motion_replaced", "belief_status",
    "belief_probability", "x_m", "y_m", "yaw_rad", "sigma_x_m", "sigma_y_m", "sigma_yaw_rad", "true_x_m", "true_y_m",
    "true_yaw_rad", "clearance_m", "collided", "forward_mps", "turn_radps", "duration_s",
)
# phase -> the trajectories of its beliefs and of its true poses
TRAJECTORIES = {"survey": ("estimate", "truth_survey"), "patrol": ("patrol", "truth_patrol"),
                "localise": ("localised", "truth_localised")}
TUM_HEADER = "# stamp_s x_m y_m z_m qx qy qz qw\n"


def step_row(step: Step) -> dict[str, object]:
    """One row of steps.csv: what was believed, what was true, how long each stage took."""
    x, y, yaw = planar(step.belief.map_from_body)
    covariance, rotation = step.belief.covariance, step.belief.map_from_body[:3, :3]
    position, turn = (rotation @ covariance[part, part] @ rotation.T for part in (slice(0, 3), slice(3, 6)))  # in the map
    sigma = np.sqrt(np.maximum([position[0, 0], position[1, 1], turn[2, 2]], 0.0))
    true = planar(step.truth) if step.truth is not None else np.full(3, np.nan)
    command = step.command
    row: dict[str, object] = {
        "index": step.index, "phase": step.phase, "stamp_s": float(step.stamp_s), "mission": step.mission,
        "event": str(step.event)[:LONGEST_TEXT], "motion_status": str(step.motion.status),
        "motion_reason": str(step.motion.reason)[:LONGEST_TEXT],
        "motion_replaced": int(step.motion.replaced),
        "belief_status": str(step.belief.status), "belief_probability": float(step.belief.probability),
        "x_m": float(x), "y_m": float(y), "yaw_rad": float(yaw),
        "sigma_x_m": float(sigma[0]), "sigma_y_m": float(sigma[1]), "sigma_yaw_rad": float(sigma[2]),
        "true_x_m": float(true[0]), "true_y_m": float(true[1]), "true_yaw_rad": float(true[2]),
        "clearance_m": float(step.clearance_m), "collided": int(step.collided),
        "forward_mps": float(command.forward_mps) if command else np.nan,
        "turn_radps": float(command.turn_radps) if command else np.nan,
        "duration_s": float(command.duration_s) if command else np.nan,
    }
    row |= {f"motion_{name}": float(value) for name, value in step.motion.details.items()}
    row |= {f"belief_{name}": float(value) for name, value in step.belief.details.items()}
    row |= {f"{stage}_ms": float(value) for stage, value in step.timings_ms.items()}
    return row


class StepTable:
    """Takes the steps of a run, in order, and leaves steps.csv, estimate.tum, patrol.tum and the truth beside them."""

    def __init__(self, folder: Path):
        self._folder = Path(folder)
        self.partial = self._folder / f"{PARTIAL}{os.getpid()}"
        try:
            self._file = self.partial.open("w", encoding="utf-8", newline="\n")
        except OSError as error:
            raise RhsError(f"cannot write {self.partial}: {error.strerror or error}") from error

    def add(self, step: Step) -> None:
        """Append one step; it survives a killed process."""
        names = TRAJECTORIES.get(step.phase, TRAJECTORIES["patrol"])
        poses = zip(names, (step.belief.map_from_body, step.truth), strict=True)
        self.add_row(step_row(step), {name: tum_line(step.stamp_s, pose) for name, pose in poses if pose is not None})

    def add_row(self, row: Mapping[str, object], lines: Mapping[str, str]) -> None:
        """Append a row of steps.csv and the lines of the trajectories that belong to it."""
        self.add_rows(json.dumps([row, lines]) + "\n")

    def add_rows(self, rows: str) -> None:
        """Append rows as they stand in the partial file of a table."""
        try:
            self._file.write(rows)
            self._file.flush()
        except OSError as error:
            raise RhsError(f"cannot write {self.partial}: {error.strerror or error} ({free_space(self.partial)})") from error

    def close(self) -> None:
        """Give the files their final names."""
        if self._file.closed:
            return
        tabulate(self.partial, self._folder)
        self._file.close()
        self.partial.unlink()


def tabulate(partial: Path, folder: Path) -> int:
    """steps.csv and the trajectories from the rows of a partial file; the number of steps. A last row that was cut is left
    out. Columns: the fixed ones, then details and timings in alphabetical order."""
    extra: set[str] = set()
    names: set[str] = set()
    count = 0
    for row, lines in _whole_rows(partial):
        extra |= row.keys() - set(COLUMNS)
        names |= lines.keys()
        count += 1
    columns = [*COLUMNS, *sorted(extra, key=lambda name: (name.endswith("_ms"), name))]
    with replacing(folder / "steps.csv") as file:
        table = csv.DictWriter(file, columns, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(_plain(row) for row, _ in _whole_rows(partial))
    for name in sorted(names):  # of poses that never came an absent file says so; an empty one would pass for a result
        with replacing(folder / f"{name}.tum") as file:
            file.write(TUM_HEADER)
            file.writelines(lines[name] for _, lines in _whole_rows(partial) if name in lines)
    return count


def _whole_rows(partial: Path) -> Iterator[tuple[dict[str, object], dict[str, str]]]:
    with partial.open(encoding="utf-8", newline="\n") as file:
        for line in file:
            try:
                row, lines = json.loads(line)
            except ValueError:
                return
            yield row, lines


def _plain(row: dict[str, object]) -> dict[str, object]:
    """NaN as an empty field, so that unknown reads back as unknown in any program."""
    return {name: "" if isinstance(value, float) and np.isnan(value) else value for name, value in row.items()}
