"""What readers of folders share: views listed and read one at a time, stamps by names or a rate, true poses."""

from __future__ import annotations

import calendar
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError, RecordingError
from rhs.api.geometry import Camera
from rhs.api.records import Capture

from ..replay_images import UnreadableImage
from ..replay_stamps import UNITS_S, Truth, read_tum_truth, typed_file
from ..replay_tum import UNREADABLE, Recording
from .poses import poses_by_first, poses_by_frame, poses_by_line, poses_by_number

_NUMBERED = re.compile(r"^(.*?)(\d+(?:\.\d+)?)$")
_AND_TIME = re.compile(r"^\d{7}-(\d{12})$")  # number, and microseconds from the beginning (SUN3D, Redwood's objects)
_IN_TWO = re.compile(r"^(?:.*\D)?(\d{10})[_-](\d{1,9})$")  # a Unix time in seconds and its fraction, of one stamp
_DATED = re.compile(r"(?:^|.*\D)((?:19|20)\d\d)[-_.]?(0[1-9]|1[0-2])[-_.]?([0-3]\d)[-_. T]?([01]\d|2[0-3])[-_.:h]?"
                    r"([0-5]\d)[-_.:m]?([0-5]\d)(?:[-_.,s]?(\d{3}|\d{6}|\d{9})|\.(\d{1,9}))?Z?$")  # date, time of day
_DIGITS = re.compile(r"[\d.]+")
UNIX_S = 1e8  # of 1973; numbers of views are smaller
SERIES = 0.25  # share of the files of a folder from which on names of another kind are another series
Pose = Callable[[int], np.ndarray | None]
At = Callable[[int, float], np.ndarray | None]


@dataclass(frozen=True, eq=False)
class Listed:
    """A recording as a list. stamps_s (N,) ascending. read(i, before): the fields of the Capture of view i, where `before`
    is the view used before it or None; raises UnreadableImage. pose(i): true world_from_body or None. timed: somebody says
    when the views were taken."""

    where: str
    stamps_s: np.ndarray
    read: Callable[[int, int | None], dict[str, Any]]
    camera: Camera
    provides: frozenset[str]
    pose: Pose = lambda i: None
    rejected: Counter = field(default_factory=Counter)
    repaired: Counter = field(default_factory=Counter)
    timed: bool = True
    right: Camera | None = None


def led(listed: Listed, settings) -> Recording:
    """The views that start, stride and count choose; those that cannot be read are left out and said to be lost."""
    wanted = range(len(listed.stamps_s))[settings.start :: settings.stride][: settings.count or None]
    if not wanted:
        total = len(listed.stamps_s)
        raise ConfigError(f"{listed.where}: source.start={settings.start} but the recording has {total} views")
    lost: list[str] = []

    def views():
        index = 0
        before = None
        for i in wanted:
            try:
                fields = listed.read(i, before)
            except ConfigError as error:
                if index == 0 and not isinstance(error, UnreadableImage):
                    raise
                listed.rejected[UNREADABLE] += 1
                lost[:] = [f"{listed.rejected[UNREADABLE]} of {len(wanted)} views cannot be read, the last: {error}"]
                continue
            yield Capture(index, float(listed.stamps_s[i]), sensed=True, **fields), listed.pose(i)
            index, before = index + 1, i

    return Recording(listed.camera, views(), len(wanted), listed.rejected, provides=listed.provides, lost=lost,
                     repaired=listed.repaired, timed=listed.timed, right=listed.right)


def numbered(files: Iterable[Path], tail: str = "") -> list[tuple[str, Path]]:
    """(number at the end of the name, before `tail`, as it is written, file) in order of the numbers; those without one are
    left out. Where all names end in the two parts of a ROS time (cloud_1583836591_182590976.pcd), or in a date and a time of
    day (2024-05-01_10-00-59.500.png), the number is that time, Unix."""
    files = list(files)
    dated = [(match, file) for file in files if not file.name.startswith(".")
             and (match := _DATED.match(file.stem.removesuffix(tail)))]
    found = [(match[2], file) for file in files if not file.name.startswith(".")  # ._1.png: macOS's, beside each
             and (match := _NUMBERED.match(file.stem.removesuffix(tail)))]
    and_time = [match for _, file in found if (match := _AND_TIME.match(file.stem.removesuffix(tail)))]
    if len(and_time) == len(found):
        found = [(f"{int(match[1]) * 1e-6:.6f}", file) for match, (_, file) in zip(and_time, found, strict=True)]
    if found and len(dated) == len(found) and (seconds := _unix(match for match, _ in dated)):
        found = [(second, file) for second, (_, file) in zip(seconds, dated, strict=True)]
    in_two = [match for _, file in found if (match := _IN_TWO.match(file.stem.removesuffix(tail)))]
    if len(in_two) == len(found):
        digits = max((len(match[2]) for match in in_two), default=9)  # nanoseconds, or whole milli- or microseconds
        found = [(f"{match[1]}.{match[2].zfill(digits if digits in (3, 6) else 9)}", file)
                 for match, (_, file) in zip(in_two, found, strict=True)]
    return sorted(found, key=lambda pair: (float(pair[0]), [*map(int, re.findall(r"\d+", pair[1].stem))], pair[1].name))


def _unix(dates: Iterable[re.Match[str]]) -> list[str]:
    """Unix seconds of dates and times of day in UTC; none at all where one is no day of the calendar."""
    with suppress(ValueError):
        return [f"{calendar.timegm(time.strptime(' '.join(date.groups()[:6]), '%Y %m %d %H %M %S'))}."
                f"{date[7] or date[8] or 0}" for date in dates]
    return []


def one_series(files: Sequence[tuple[str, Path]]) -> None:
    """Refuse numbered files of two kinds of names (r-1.5-10.ppm, d-1.4-11.pgm), or of which some have one number
    (left_001.png, right_001.png): two series would be led as one.
    Where all have the same (scan_2_of_90.pcd) that counts nothing."""
    of: dict[float, list[Path]] = {}
    kinds: dict[str, list[Path]] = {}
    for number, file in files:
        of.setdefault(float(number), []).append(file)
        kinds.setdefault(_DIGITS.sub("", file.name.lower()), []).append(file)
    twice = next((same for same in of.values() if len(same) > 1), None)
    if twice is not None and len(of) > 1:
        raise ConfigError(f"{twice[0].parent}: found {twice[0].name} and {twice[1].name}, two of one number; expected one "
                          "series in a folder: move the others to one of their own")
    first, second = [*sorted(kinds.values(), key=len, reverse=True), []][:2] if files else ([], [])
    if len(second) > max(1, SERIES * len(files)):
        raw = {first[0].name[:2], second[0].name[:2]} == {"r-", "d-"}
        how = ("of NYU's raw images, whose depth is no distance: export them by its toolbox" if raw else
               "expected one in a folder: move the others to one of their own")
        raise ConfigError(f"{first[0].parent}: found {first[0].name} and {second[0].name}, two series; {how}")


def stamps_by_name(numbers: list[str], rate_hz: float, usual_hz: float) -> tuple[np.ndarray, bool]:
    """(N,) seconds of files by the numbers in their names, and whether these are times: seconds with a fraction, or the 10,
    13, 16 or 19 digits, before a point, of a Unix time (KITTI's 0000000012 is none). Else, or where a rate was typed, at
    that rate."""
    whole = [UNITS_S.get(len(number)) if number[0] != "0" else None for number in numbers if "." not in number]
    if rate_hz == 0.0 and numbers and all(whole):
        return np.array([float(n) * UNITS_S.get(len(n.split(".")[0]), 1.0) for n in numbers]), True
    return np.arange(len(numbers)) / (rate_hz or usual_hz), False


def matrix34(numbers: list[float]) -> np.ndarray:
    """4x4 of the 12 numbers of a 3x4 matrix, row by row."""
    return np.vstack([np.array(numbers, float).reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])


def truth_of(file: Path | None, settings, numbers: Sequence[str] = (), *, untimed: bool = False) -> tuple[At, Counter]:
    """True poses by (line from 0, stamp) from a file, typed or found: of a TUM file (8 columns) by the stamp, of those of
    poses.py by the line, or of a folder by the numbers of the views in their names. Poses as the file has them; None where
    it has none. untimed: the views have no stamps of their own: as many poses as views are one each."""
    if settings.truth:
        return _truth_in(typed_file(settings.truth), settings, numbers, untimed=untimed)
    if file is None:
        return (lambda line, stamp_s: None), Counter()
    try:
        return _truth_in(file, settings, numbers, untimed=untimed)
    except (ConfigError, RecordingError) as error:
        raise ConfigError(f"{error}; {file.name} was taken for the true poses of the views beside it: rename it to go "
                          "without them, or type source.truth=FILE") from None


def _truth_in(file: Path, settings, numbers: Sequence[str], *, untimed: bool) -> tuple[At, Counter]:
    if file.is_dir():
        named = poses_by_number(file)
        return (lambda line, stamp_s: named.get(int(float(numbers[line])))), Counter()
    poses = poses_by_line(file)
    if poses is not None:
        return (lambda line, stamp_s: poses.get(line)), Counter()
    first = poses_by_frame(file) if untimed else None
    first = first or poses_by_first(file)
    if first is not None and (untimed or _by_number(first, numbers)):
        return (lambda line, stamp_s: first.get(float(numbers[line]))), Counter()
    if first is not None:
        known = sorted(stamp for stamp, pose in first.items() if pose is not None)
        stamped = Truth(np.array(known), np.array([first[stamp] for stamp in known]), settings.max_truth_gap_s)
        return (lambda line, stamp_s: stamped.at(stamp_s)), Counter(truth_unknown=len(first) - len(known))
    truth = read_tum_truth(file, settings)
    if untimed and (file.suffix == ".json" or file.name == "images.txt"):  # of each image by the number in its name
        of = dict(zip(truth.stamps_s.tolist(), truth.poses, strict=True))
        return (lambda line, stamp_s: of.get(float(numbers[line]))), Counter()
    if untimed and len(truth.stamps_s) == len(numbers):
        return (lambda line, stamp_s: truth.poses[line]), Counter()
    return (lambda line, stamp_s: truth.at(stamp_s)), Counter({f"truth_{k}": v for k, v in truth.rejected.items()})


def _by_number(keys: Iterable[float], numbers: Sequence[str]) -> bool:
    """Whether poses stand behind the numbers of the views, though these have times beside them (KITTI-360): whole ones, too
    small for a Unix time."""
    return bool(numbers) and not any("." in number for number in numbers) and all(
        key == int(key) and key < UNIX_S for key in keys)


def moved(pose: np.ndarray | None, then: np.ndarray) -> np.ndarray | None:
    """pose @ then, or None of an unknown pose."""
    return None if pose is None else pose @ then
