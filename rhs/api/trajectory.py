"""Trajectories: TUM files, association by time, alignment.

A TUM line is `stamp_s x y z qx qy qz qw`: metres, unit quaternion with w last, `#` begins a comment. A table whose header
names its columns may have them in any order.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np

from rhs.base.commands import check_regular
from rhs.base.errors import RecordingError

from .files import replacing
from .geometry import align, inverse, se3
from .pose_exports import advice_for, exported

log = logging.getLogger("rhs.trajectory")
_STAMP = re.compile(r"(t|time|time_?stamp|date_?time|stamp|sec|secs|seconds|nsec|nanoseconds)(_?(s|ms|us|ns|sec|nsec))?")
_NO_POSE = re.compile(r"^(v|b|a|w|bw|ba|bg)_|vel|twist|acc|gyr|bias|cov|quality|^[fc][xy]$|(roll|pitch|yaw)(_deg)?$")
_TUM, _EUROC = [*range(8)], [0, 1, 2, 3, 5, 6, 7, 4]  # stamp x y z qw qx qy qz
_EUROC_ROW = re.compile(r"\d{19}(,[^,]+){7}(,[^,]+){0,3},?$|\d{19}(,[^,]+){16},?$")  # thirteen are MulRan's
_ANGLE = re.compile(r"(?:.*[._ ])?(roll|pitch|yaw|theta|heading|th)[_ ]?(rad|radians|deg|degrees)?")
_NCLT_ROW = re.compile(r"\d{16}(,\s*[^,\s]+){6}$")  # microseconds, x y z, roll pitch heading
_ECHO_ROW = re.compile(r"\d{1,10},\d{1,9},[a-zA-Z_/][^,]*,([a-zA-Z_/][^,]*,)?[-\d]")  # ros2 topic echo --csv: s, ns, frames
_DATE = re.compile(r"\b(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.](\d+)|,(\d+)(?=;))?(Z\b|[-+]\d\d:?\d\d\b)?")
_LOST_ROW = re.compile(r"[-+.\deE]+(?:[,;\s]+[-+]?nan){7,}[,;\s]*|[-+.\deE]+[,;]{7,}\s*", re.I)  # a stamp, and nothing more
_DIGITS = {13: 3, 16: 6, 18: 7, 19: 9}  # of a time in ms, us, Windows' 100 ns and ns; so many of them are behind the point
_SAID_UNITS = {r"ns\b|nano|nsec": 9, r"us\b|micro|usec": 6, r"ms\b|milli|msec": 3}  # in the name of a column of stamps
_UNIT = 0.05  # a quaternion may be so much longer or shorter than 1; files are rounded
_NED = {"northing": "x", "easting": "y", "down": "z"}  # of Oxford RobotCar's ins.csv and rtk.csv
MOST_HEADING = 6.3  # that is taken for radians where nobody says
ALIGNMENTS = ("none", "origin", "yaw", "se3", "sim3")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """stamps_s (N,) float64, not decreasing; poses (N, 4, 4) float64 `frame_from_body`."""

    stamps_s: np.ndarray
    poses: np.ndarray

    def __len__(self) -> int:
        return len(self.stamps_s)

    def __repr__(self) -> str:
        last_s = self.stamps_s[-1] - self.stamps_s[0] if len(self) else 0.0
        return f"Trajectory({len(self)} poses, {last_s:.1f} s, {np.append(self.travelled_m, 0.0).max():.2f} m)"

    @property
    def positions_m(self) -> np.ndarray:
        """(N, 3) positions."""
        return self.poses[:, :3, 3]

    @property
    def travelled_m(self) -> np.ndarray:
        """(N,) distance travelled up to each pose; the first is 0."""
        steps = np.linalg.norm(np.diff(self.positions_m, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])[: len(self)]

    def take(self, indices: np.ndarray) -> Trajectory:
        """The poses at `indices`."""
        return Trajectory(self.stamps_s[indices], self.poses[indices])


def tum_line(stamp_s: float, pose: np.ndarray) -> str:
    """One line of a TUM file, with its line end; never a minus before zero."""
    from .geometry import quaternion_xyzw

    numbers = [*pose[:3, 3], *quaternion_xyzw(pose[:3, :3])]
    return f"{stamp_s:.9f} " + " ".join(f"{round(float(v), 9) + 0.0:.9f}" for v in numbers) + "\n"


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory; the file appears whole or not at all."""
    with replacing(Path(path)) as file:
        file.write("# stamp_s x_m y_m z_m qx qy qz qw\n")
        file.writelines(tum_line(s, p) for s, p in zip(trajectory.stamps_s, trajectory.poses, strict=True))


def read_tum(path: Path) -> Trajectory:
    """Read a TUM file, sorted by time; of equal stamps the first line counts, and one whose numbers behind the stamp are all
    NaN or empty is none: its moment has no pose, and how many there are is said.

    Raises RecordingError naming file and line for anything that is not eight finite numbers with a usable quaternion.
    """
    rows, lost = [], []
    for number, line in enumerate(in_tum_order(_text(Path(path)), str(path)).splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if _LOST_ROW.fullmatch(line):
            lost.append(number)
        elif words:
            rows.append(_tum_row(words, f"{path}:{number}"))
    if lost:
        share = len(rows) / (len(rows) + len(lost))
        log.warning("%s:%d: found a stamp and no pose, as in %d line%s in all; left out: %.1f %% of the moments have one",
                    path, lost[0], len(lost), "" if len(lost) == 1 else "s", 100.0 * share)
    table = np.array(rows).reshape(-1, 8)
    table[:, 0] *= [seconds_in(stamp) for stamp in table[:, 0]]
    _, first = np.unique(table[:, 0], return_index=True)
    table = table[first]
    return Trajectory(table[:, 0], _poses(table[:, 1:4], table[:, 4:8]))


def seconds_in(stamp: float) -> float:
    """Seconds in the unit of a stamp: a Unix time of these years in ms, us or ns has 13, 16 or 19 digits before its point
    (ORB-SLAM3 writes 1403636579763555584.000000); others are seconds."""
    return next((10.0**-behind for digits, behind in _DIGITS.items() if 10.0 ** (digits - 1) <= stamp < 10.0**digits), 1.0)


def in_tum_order(text: str, where: str = "line") -> str:
    """A table of poses with its columns as a TUM file has them and stamps in seconds, where a header names them
    (`timestamp,p_x [m],...,q_w []`, `time;x;y;z;qx;qy;qz;qw`, `sec,nsec,x,...`, `time,x,y,yaw`, `t,x,y,z,roll,pitch,yaw`,
    commented or not), or EuRoC's, which begins with whole nanoseconds and a comma, NCLT's, with angles, or that of `ros2
    topic echo --csv`, without one, line by line; or an export of another program (pose_exports). Times of ISO 8601 become
    Unix seconds. Another text as it is. where: its file. Raises RecordingError of angles whose unit nobody says."""
    if (other := exported(text, where)) is not None:
        return other
    text = in_unix_time(text, where)
    lines = text.splitlines()
    for k, line in enumerate(lines):
        order = _columns(line)
        if order:
            digits = _said_behind(line, order[0])
            return "\n".join([*[""] * (k + 1), *(_ordered(row, order, digits) for row in lines[k + 1 :])])
        if angled := _angled_columns(line):
            below = enumerate(lines[k + 1 :], start=k + 2)
            digits = _said_behind(line, angled[0][0])
            turned = (_of_named_angles(row, f"{where}:{number}", *angled, digits) for number, row in below)
            return "\n".join([*[""] * (k + 1), *turned])
        if words := line.split("#", 1)[0].strip():
            if _NCLT_ROW.match(words):
                return "\n".join(map(_of_angles, lines))
            plain = _EUROC if _EUROC_ROW.match(words) else _TUM if ";" in words else []
            if echoed := _ECHO_ROW.match(words):
                begin = 4 if echoed[1] else 3
                plain = [0, *range(begin, begin + 7), 1]
            return "\n".join(_ordered(row, plain) for row in lines) if plain else text
    return text


def in_unix_time(text: str, where: str = "line") -> str:
    """A text with its times of ISO 8601 as Unix seconds; itself where it has none but in comments. Raises RecordingError."""
    if not any(_DATE.search(line.split("#", 1)[0]) for line in text.splitlines()):
        return text
    return _DATE.sub(partial(_unix, where=where), text)


def _unix(date: re.Match[str], where: str) -> str:
    """Unix seconds of a time of ISO 8601; one that names no zone is taken for UTC. Raises RecordingError."""
    try:
        whole = datetime.fromisoformat(f"{date[1]}T{date[2]}{date[5] or '+00:00'}")
    except ValueError as error:
        raise RecordingError(f"{where}: found the time {date[0]!r} ({error}); expected one of ISO 8601") from None
    return f"{int(whole.timestamp())}.{date[3] or date[4] or 0}"


def _columns(header: str) -> list[int]:
    """Where stamp x y z qx qy qz qw stand, by the names in a header, and behind them the nanoseconds of a stamp in two
    columns; empty where it does not name each of them once. 4Seasons calls its stamps frame_id."""
    separator = ";" if ";" in header else "," if "," in header else None
    found: dict[str, list[int]] = {}
    for k, name in enumerate(header.lstrip("#%\ufeff ").split(separator)):
        name = re.sub(r"[\[(].*", "", name.strip(" \"'_").lower()).strip()
        turn = "q" if re.search(r"q|ori|rot", name[:-1]) else ""
        if not _NO_POSE.search(name):
            key = name if name in ("nsec", "frame_id") else "t" if _STAMP.fullmatch(name) else turn + name[-1:]
            found.setdefault(key, []).append(k)
    stamps = found.get("t") or found.get("nsec") or found.get("frame_id", [])
    wanted = [stamps, *(found.get(key, []) for key in ("x", "y", "z", "qx", "qy", "qz", "qw"))]
    wanted += [found["nsec"]] if "t" in found and "nsec" in found else []
    return [ks[0] for ks in wanted] if all(len(ks) == 1 for ks in wanted) else []


def _angled_columns(header: str) -> tuple[list[int], float] | None:
    """Where stamp x y heading stand, by the names in a header that names each of them once and no z, or stamp x y z roll
    pitch heading, and the radians of one step of an angle, 0 where it is not said; None of another header."""
    separator = ";" if ";" in header else "," if "," in header else None
    found: dict[str, list[int]] = {}
    radians = 0.0
    for k, name in enumerate(header.lstrip("#%\ufeff ").split(separator)):
        name = re.sub(r"[\[(\s]+", " ", name.strip(" \"'_").lower()).rstrip(" )]")
        name = _NED.get(name, name)
        plain = re.split(r"[._ ]", name)
        key = "t" if _STAMP.fullmatch(name.split(" ")[0]) else next((axis for axis in "xyz" if axis in plain), "")
        if angle := _ANGLE.fullmatch(name):
            key, unit = angle[1] if angle[1] in ("roll", "pitch") else "heading", angle[2] or ""
            radians = np.pi / 180.0 if unit.startswith("deg") else float(bool(unit))
        if key and not re.search(r"vel|twist|acc|^v_", name):
            found.setdefault(key, []).append(k)
    keys = ("t", "x", "y", "z", "roll", "pitch", "heading") if "z" in found else ("t", "x", "y", "heading")
    wanted = [found.get(key, []) for key in keys]
    return ([ks[0] for ks in wanted], radians) if all(len(ks) == 1 for ks in wanted) else None


def _of_named_angles(row: str, where: str, order: list[int], radians: float, said: int) -> str:
    """A row with angles (about fixed axes, roll first, as in ROS; on the floor heading alone) with a quaternion; as it is
    where it is none. Raises RecordingError where the angles may be of either unit."""
    words = _cells(row)
    try:
        stamp, x, y, *rest = (words[k] for k in order)
        z, *angles = [float(word) for word in rest] if len(rest) > 1 else [0.0, 0.0, 0.0, float(rest[0])]
    except (ValueError, IndexError):
        return row
    if not radians and np.abs(angles).max() > MOST_HEADING:
        angle = max(rest[-3:], key=lambda word: abs(float(word)))
        raise RecordingError(f"{where}: the heading {angle} is more than a turn of radians; expected a header that says "
                             "yaw_deg or yaw_rad")
    return f"{_in_seconds(stamp, said)} {x} {y} {z:.9g} {_turned(np.array(angles) * (radians or 1.0))}"


def _turned(angles: np.ndarray) -> str:
    """The quaternion of roll, pitch and heading, radians about fixed axes, w last."""
    from scipy.spatial.transform import Rotation

    return " ".join(f"{v:.9f}" for v in Rotation.from_euler("xyz", angles).as_quat())


def _cells(row: str) -> list[str]:
    """The words of a row; commas beside semicolons are those of decimals, as spreadsheets of many countries write them."""
    plain = row.split("#", 1)[0].replace('"', " ")
    return plain.replace(",", "." if ";" in plain else " ").replace(";", " ").split()


def _said_behind(header: str, column: int) -> int:
    """How many digits of a stamp are behind its point, by the unit in the name of its column; 0 where it names none."""
    separator = ";" if ";" in header else "," if "," in header else None
    name = header.lstrip("#%\ufeff ").split(separator)[column].lower()
    return next((digits for unit, digits in _SAID_UNITS.items() if re.search(unit, name)), 0)


def _ordered(row: str, order: list[int], said: int = 0) -> str:
    words = _cells(row)
    if len(words) <= max(order):
        return row
    words = [words[k] for k in order]
    if len(words) > len(_TUM):
        return f"{words[0]}.{words[-1].zfill(9)} {' '.join(words[1:-1])}"
    return " ".join([_in_seconds(words[0], said), *words[1:]])


def _in_seconds(stamp: str, said: int) -> str:
    """A stamp with its point where its column's unit, or the digits of a whole Unix time, put it."""
    whole, _, rest = stamp.partition(".")
    behind = (said if len(whole) != 10 else 0) if rest else said or _DIGITS.get(len(whole), 0)  # ten: Unix seconds
    if not behind or not (whole + rest).isdigit():
        return stamp
    whole = whole.zfill(behind + 1)
    return f"{whole[:-behind]}.{whole[-behind:]}{rest}"


def _of_angles(row: str) -> str:
    """NCLT's line, its angles about fixed axes as a quaternion; nothing of one that holds nan."""
    words = row.split("#", 1)[0].replace(",", " ").split()
    if not _NCLT_ROW.match(row.strip()) or "nan" in row.lower():
        return row if "nan" not in row.lower() else ""
    try:
        turn = _turned(np.array(words[4:], float))
    except ValueError:
        return row
    return f"{words[0][:-6]}.{words[0][-6:]} {' '.join(words[1:4])} {turn}"


def _text(path: Path) -> str:
    try:
        check_regular(path)
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        advice = advice_for(str(path)) or "expected a TUM trajectory file"
        raise RecordingError(f"{path} is not text (byte {error.start}); {advice}") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def _tum_row(words: list[str], where: str) -> list[float]:
    try:
        row = [float(word) for word in words]
    except ValueError:
        row = []
    if len(row) != 8 or not np.all(np.isfinite(row)):
        alone = ("; of places alone write 0 0 0 1 behind each (rotations then tell nothing), of headings `t x y yaw` as the "
                 "first line" if len(row) == 4 else "")
        raise RecordingError(f"{where}: found '{' '.join(words)[:60]}', expected 8 finite numbers: "
                             f"stamp x y z qx qy qz qw{alone}")
    check_unit(row[4:], where)
    return row


def check_unit(quaternion: Sequence[float], where: str) -> None:
    """Refuse four numbers that are no unit quaternion, but for rounding: angles, or a column too many."""
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > _UNIT:
        how = f"is {length:.3g} long" if length else "has no direction"
        raise RecordingError(f"{where}: quaternion {list(quaternion)} {how}; expected a unit quaternion qx qy qz qw behind "
                             "stamp x y z")


def _poses(positions: np.ndarray, quaternions_xyzw: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    if len(positions):
        poses[:, :3, :3] = Rotation.from_quat(quaternions_xyzw).as_matrix()
        poses[:, :3, 3] = positions
    return poses


def associate(a_s: np.ndarray, b_s: np.ndarray, tolerance_s: float) -> np.ndarray:
    """(M, 2) index pairs of stamps at most `tolerance_s` apart, one to one, nearest first, sorted by time.

    The greedy rule of the TUM benchmark's associate.py, in O(n log n) for stamps in order.
    """
    a_s, b_s = np.asarray(a_s, float), np.asarray(b_s, float)
    low, high = np.searchsorted(b_s, a_s - tolerance_s), np.searchsorted(b_s, a_s + tolerance_s, side="right")
    candidates = sorted((abs(a_s[i] - b_s[j]), i, j) for i in range(len(a_s)) for j in range(low[i], high[i]))
    used_a: set[int] = set()
    used_b: set[int] = set()
    pairs = []
    for _, i, j in candidates:
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            pairs.append((i, j))
    return np.array(sorted(pairs), dtype=int).reshape(-1, 2)


def aligned(estimate: Trajectory, truth: Trajectory, how: str) -> Trajectory:
    """The estimate moved onto the truth (same length, paired by index).

    how: `none`; `origin` (first poses made equal); `yaw` (rotation about z and translation); `se3` (Umeyama 1991
    without scale); `sim3` (with scale: for one camera that knows no metres).
    """
    if how not in ALIGNMENTS:
        raise ValueError(f"alignment {how!r} is not one of {', '.join(ALIGNMENTS)}")
    if how == "none" or not len(estimate):
        return estimate
    scale = 1.0
    if how == "origin":
        move = truth.poses[0] @ inverse(estimate.poses[0])
    elif how == "yaw":
        move = _align_yaw(estimate.positions_m, truth.positions_m)
    else:
        move, scale = align(estimate.positions_m, truth.positions_m, with_scale=how == "sim3")
    poses = estimate.poses.copy()
    poses[:, :3, 3] *= scale
    return Trajectory(estimate.stamps_s, move @ poses)


def _align_yaw(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Least-squares rotation about z and translation, closed form."""
    from .geometry import rotation_z

    s, t = source - source.mean(0), target - target.mean(0)
    yaw = np.arctan2((s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]).sum(), (s[:, :2] * t[:, :2]).sum())
    rotation = rotation_z(yaw)
    return se3(rotation, target.mean(0) - rotation @ source.mean(0))
