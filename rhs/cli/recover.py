"""`python -m rhs recover FOLDER ...`: what killed runs left, made into whole run folders.

In every folder below whose run was killed: steps.csv and the trajectories from the steps that reached the disk (from
run.mcap where those are lost), run.mcap with an index again, and a row with the figures of what is there, status `killed`.
Nothing that is whole is touched; a run that is still under way is left alone.

Exit code 0; 2 refused; 3 when something could not be recovered.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.geometry import planar
from rhs.api.trajectory import tum_line
from rhs.base.commands import Arguments, answered, complain, plain
from rhs.base.errors import ConfigError, RecordingError, RhsError
from rhs.metrics.evaluate import evaluate
from rhs.metrics.success import with_success
from rhs.recording import ros
from rhs.recording.mcap_scan import open_scan
from rhs.recording.reader import STEP, read
from rhs.recording.recover import recover as mend
from rhs.reports.table import find_rows
from rhs.runfolder.folders import claim_again
from rhs.runfolder.row import KILLED, read_row, sound, write_row
from rhs.runfolder.steps_csv import PARTIAL, StepTable, tabulate
from rhs.sweeps.runs import rows_in_shards


def recover(folder: Path) -> str:
    """Recover the killed run of one folder; what was found, in words. Raises RhsError when somebody is at work there."""
    with claim_again(folder):
        row = read_row(folder / "row.json") if (folder / "row.json").exists() else {}
        steps, where = _steps(folder)
        recording = _recording(folder)
        known = {name: value for name, value in row.items() if name not in ("pid", "started")}
        reason = f"the process ended without a word; recovered: {steps} steps from {where}"
        known |= {"status": KILLED, "reason": reason, "views": steps}
        write_row(folder, sound(with_success({**known, **evaluate(folder, str(row.get("task", "patrol")))})))
    return f"{steps} steps from {where}{recording}"


def _steps(folder: Path) -> tuple[int, str]:
    """steps.csv and trajectories from what was kept of the steps; their number, and where they came from."""
    partial = max(folder.glob(f"{PARTIAL}*"), key=lambda path: path.stat().st_size, default=None)
    if partial is not None:
        count = tabulate(partial, folder)
        for left in folder.glob("*.tmp-*"):
            left.unlink()
        return count, "steps.jsonl"
    if (folder / "steps.csv").exists():
        return len((folder / "steps.csv").read_text("utf-8").splitlines()) - 1, "steps.csv"
    if not (folder / "run.mcap").exists():
        return 0, "nothing"
    table, count = StepTable(folder), 0
    for message in read(folder / "run.mcap"):
        if message.channel.topic == STEP:
            table.add_row(*_row_of(json.loads(ros.deserialize(message.data, "std_msgs/msg/String").data)))
            count += 1
    table.close()
    return count, "run.mcap"


def _row_of(step: dict[str, Any]) -> tuple[dict[str, object], dict[str, str]]:
    """A row of steps.csv and the lines of the trajectories, of a recorded step (rhs.recording.writer.step_to_plain).
    Sigmas, details and times are not recorded there."""
    pose, truth, command = np.array(step["map_from_body"]), step["truth"], step["command"] or [np.nan] * 3
    survey = step["phase"] == "survey"
    names = ("x_m", "y_m", "yaw_rad")
    row: dict[str, object] = {
        "index": step["step"], "phase": step["phase"], "stamp_s": step["stamp_s"], "mission": step["mission"],
        "event": step["event"], "motion_status": step["motion"], "motion_reason": step["reason"],
        "belief_status": step["belief"], "belief_probability": step["probability"],
        "clearance_m": step["clearance_m"], "collided": int(step["collided"]),
        **dict(zip(("forward_mps", "turn_radps", "duration_s"), command, strict=True)),
        **dict(zip(names, map(float, planar(pose)), strict=True)),
    }
    lines = {"estimate" if survey else "patrol": tum_line(step["stamp_s"], pose)}
    if truth is not None:
        true = np.array(truth)
        row |= {f"true_{name}": float(value) for name, value in zip(names, planar(true), strict=True)}
        lines["truth_survey" if survey else "truth_patrol"] = tum_line(step["stamp_s"], true)
    return row, lines


def _recording(folder: Path) -> str:
    """Give a cut run.mcap its index; what became of it, in words."""
    path = folder / "run.mcap"
    if not path.exists():
        return ""
    try:
        open_scan(path)[0].close()
        report, count = mend(path, path)
    except (RecordingError, ConfigError) as error:
        return f"; run.mcap is lost: {error}"
    return f"; run.mcap: {count} messages{'' if report.whole else ', the rest is lost'}"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = Arguments(prog="python -m rhs recover", description=__doc__,
                       formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="run or sweep folders, searched through")
    return answered(lambda: _recover_all(parser.parse_args(arguments).folders))


def _recover_all(folders: Sequence[Path]) -> int:
    killed, failed = killed_runs(folders), 0
    for folder in killed:
        try:
            sys.stdout.write(f"{folder}: {plain(recover(folder))}\n")
        except (RhsError, OSError) as error:
            failed += 1
            complain(f"{folder}: cannot be recovered: {error}", 3)
    gone = Counter(folder.parent for folder, row in rows_in_shards(folders).items()
                   if row.get("status") == KILLED and not folder.is_dir())
    for sweep, count in gone.items():
        sys.stdout.write(f"{sweep}: {count} killed runs left a row and no folder; run them again: "
                         f"python -m rhs --resume {sweep}\n")
    if not killed and not gone:
        sys.stdout.write("no killed run in these folders\n")
    return 3 if failed else 0


def killed_runs(folders: Sequence[Path]) -> list[Path]:
    """The folders below whose run was killed and not recovered yet; also those of older versions, which wrote no row."""
    killed = []
    for path in find_rows(folders):
        try:
            row = read_row(path)
        except RhsError:
            continue
        if row.get("status") == KILLED and "pid" in row:
            killed.append(path.parent)
    for folder in folders:
        for partial in Path(folder).rglob(f"{PARTIAL}*"):
            if not (partial.parent / "row.json").exists() and partial.parent not in killed:
                killed.append(partial.parent)
    return killed
