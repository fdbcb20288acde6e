"""`python -m rhs.convert IN OUT`: recordings between forms, and a cut recording made whole.

    run.mcap    -> other.mcap    copies every whole message of any MCAP file and writes a new index (recovery)
    run.mcap    -> folder        a TUM RGB-D folder: rgb/, depth/ (16 bit, 5000 = 1 m), lists, groundtruth, estimate
    run.mcap    -> file.tum      the trajectory of a topic
    file.tum    -> other.mcap    poses and transforms, for viewers
    a recording -> other.mcap    whatever `source=replay` reads (TUM folder, bags, ...), for viewers and for replay

Exit code 0: all converted; 1: not readable; 2: refused; 3: converted what was whole, and something was lost.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rhs.base.commands import Arguments, answered, check_regular
from rhs.base.errors import ConfigError
from rhs.recording.mcap_scan import Report

TRAJECTORY = (".tum", ".txt")


def convert(source: Path, target: Path, *, topic: str = "/belief", settings: Sequence[str] = (),
            force: bool = False) -> tuple[str, Report | None]:
    """Convert by the kinds of the two paths; what was written, in words, and the scan of the input where there was one.
    settings: `key=value` of source=replay, for instance camera=tum_fr1.

    Raises ConfigError for a refused pair, RecordingError for an unreadable input. The target appears only when whole.
    """
    source, target = Path(source), Path(target)
    check_pair(source, target, force=force)
    from rhs.recording import recover

    from . import convert_tum

    kinds = kind_of(source), kind_of(target)
    if kinds == ("mcap", "mcap"):
        report, count = recover.recover(source, target)
        return f"{count} messages", report
    if kinds == ("mcap", "folder"):
        report, count = convert_tum.to_folder(source, target)
        return f"{count} views; depth rounded to 0.2 mm", report
    if kinds == ("mcap", "trajectory"):
        report, count = convert_tum.to_trajectory(source, target, topic)
        return f"{count} poses of {topic}", report
    if kinds == ("trajectory", "mcap"):
        return f"{convert_tum.from_trajectory(source, target)} poses", None
    if kinds[1] == "mcap":
        return f"{convert_tum.from_recording(source, target, settings)} views", None
    raise ConfigError(f"{source} -> {target}: expected .mcap, .tum or a folder on both sides and .mcap on one; "
                      f"type python -m rhs.convert --help")


def check_pair(source: Path, target: Path, *, force: bool) -> None:
    """Refuse a missing input, an output that is the input, and one that is there already."""
    if not source.exists():
        raise ConfigError(f"{source} does not exist; give a recording, a TUM folder or a trajectory")
    for path in (source, target):
        check_regular(path)
    inside = source.is_dir() and target.resolve().is_relative_to(source.resolve())
    if inside or (target.exists() and os.path.samefile(source, target)):
        raise ConfigError(f"{target} is the input itself or lies in it; give another name for the output")
    if target.exists() and (target.is_dir() or not force):
        hint = "give another name" if target.is_dir() else "give another name, or --force to replace it"
        raise ConfigError(f"{target} is there already; {hint}")
    if not target.absolute().parent.is_dir():
        raise ConfigError(f"the folder {target.absolute().parent} does not exist; make it first")


def kind_of(path: Path) -> str:
    """mcap, trajectory, folder (also one to be made) or other."""
    if path.suffix == ".mcap" and not path.is_dir():
        return "mcap"
    if path.suffix in TRAJECTORY and not path.is_dir():
        return "trajectory"
    return "folder" if path.is_dir() or not path.suffix else "other"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = Arguments(prog="python -m rhs.convert", description=__doc__,
                       formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("input", type=Path, metavar="INPUT")
    parser.add_argument("output", type=Path, metavar="OUTPUT")
    parser.add_argument("settings", nargs="*", default=[], metavar="key=value",
                        help="of source=replay, such as camera=tum_fr1")
    parser.add_argument("--topic", default="/belief", help="poses for a .tum file: /belief (default), /truth, /odom")
    parser.add_argument("--force", action="store_true", help="replace an output file that is there")
    return answered(lambda: _convert(parser.parse_args(arguments)))


def _convert(chosen: argparse.Namespace) -> int:
    written, report = convert(chosen.input, chosen.output, topic=chosen.topic, settings=chosen.settings, force=chosen.force)
    sys.stdout.write(f"{chosen.output}: {written}\n")
    if report is None or report.whole:
        return 0
    sys.stderr.write(f"{report.line}\n")
    return 3
