"""`python -m rhs.evaluate`: the figures again, from files.

    python -m rhs.evaluate RUN_FOLDER            recompute the row's figures and compare them with row.json
    python -m rhs.evaluate ESTIMATE TRUTH        ATE, RPE and completeness of two TUM, KITTI, EuRoC, MulRan, TartanAir,
                                                 g2o, TORO, COLMAP (images.txt), Open3D, Motive, Qualisys, kapture,
                                                 ARKitScenes, RobotCar, nuScenes or Nerfstudio files
    python -m rhs.evaluate EST --relations FILE  errors of published relations between scans; EST: a TUM file or a run folder

Exit code 0; 1 unreadable; 2 refused; 3 when row.json says something else than its files, or when less than half of the
poses have a partner, or of the relations both poses, or when the truth is by another clock or its poses mean something else.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rhs.api.trajectory import ALIGNMENTS, Trajectory
from rhs.base.commands import Arguments, answered, check_regular, complain
from rhs.base.errors import ConfigError, RecordingError
from rhs.metrics.evaluate import evaluate_folder, evaluate_relations, evaluate_ways, read_pair
from rhs.metrics.pose_forms import pose_fault
from rhs.metrics.success import HALF
from rhs.metrics.survey import TOLERANCE_S
from rhs.metrics.truth_clock import clock_fault
from rhs.runfolder.row import machine_dependent, read_row


def differences(folder: Path) -> list[str]:
    """Figures that row.json and the files of the folder disagree about, one line each; machine-dependent ones excepted."""
    row, again = read_row(folder / "row.json"), evaluate_folder(folder)
    return [f"{name}: row.json says {row[name]}, the files say {value}" for name, value in again.items()
            if name in row and not machine_dependent(name) and not _equal(row[name], value)]


def _equal(a: object, b: object) -> bool:
    unknown = [value is None or (isinstance(value, float) and math.isnan(value)) for value in (a, b)]
    return all(unknown) or (not any(unknown) and a == b)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = Arguments(prog="python -m rhs.evaluate", description=__doc__,
                       formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="+", type=Path, metavar="PATH", help="a run folder, or two trajectories")
    parser.add_argument("--alignment", default="se3", help=f"{', '.join(ALIGNMENTS)} (default se3)")
    parser.add_argument("--relations", type=Path, help="stamp1 stamp2 x y z roll pitch yaw of pairs of scans, on each line")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE_S, help="between stamps, seconds (default 0.02)")

    def work() -> int:
        try:
            return _print(parser.parse_args(arguments))
        except RecordingError as error:  # refused, as anywhere before something runs
            raise ConfigError(str(error)) from error

    return answered(work)


def _print(chosen: argparse.Namespace) -> int:
    for path in chosen.paths:
        check_regular(path)
    if chosen.relations is not None:
        if len(chosen.paths) != 1:
            raise ConfigError("expected one run folder or one TUM file beside --relations")
        values = evaluate_relations(chosen.paths[0], chosen.relations)
        sys.stdout.write(_lines(values))
        share = float(str(values["relations_share"]))
        return 0 if share >= HALF else complain(
            f"of only {share:.1%} of the relations both scans have a pose, and the figures are of these alone; expected at "
            f"least {HALF:.0%}: are these relations of this recording?", 3)
    if len(chosen.paths) == 2:
        ways = read_pair(*chosen.paths)
        values = evaluate_ways(*ways, alignment=chosen.alignment, tolerance_s=chosen.tolerance)
        sys.stdout.write(_lines(values))
        if fault := clock_fault(values) or pose_fault(*ways, chosen.tolerance):
            return complain(fault, 3)
        return _doubted(float(str(values["matched_share"])), chosen.tolerance, *ways)
    if len(chosen.paths) > 2:
        raise ConfigError("expected one run folder, or two trajectories (TUM, KITTI, EuRoC): ESTIMATE TRUTH")
    sys.stdout.write(_lines(evaluate_folder(chosen.paths[0])))
    wrong = differences(chosen.paths[0])
    sys.stderr.write("".join(f"{line}\n" for line in wrong))
    return 3 if wrong else 0


def _doubted(matched_share: float, tolerance_s: float, *ways: Trajectory) -> int:
    """The exit code for the figures of so many of the poses: 3, and why, where they are of a minority."""
    if matched_share >= HALF:
        return 0
    spans = " and ".join(f"{way.stamps_s[0]:.1f} to {way.stamps_s[-1]:.1f}" for way in ways if len(way))
    return complain(f"only {matched_share:.1%} of the poses have a partner within {tolerance_s:g} s (--tolerance), and the "
                    f"figures are of these alone: stamps of {spans}; another clock?", 3)


def _lines(values: Mapping[str, object]) -> str:
    return "".join(f"{name:<33}{value:.6g}\n" if isinstance(value, float) else f"{name:<33}{value}\n"
                   for name, value in values.items())
