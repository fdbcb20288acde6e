"""Rules for the time stamps of recordings, association of two lists, poses between two stamps, times of a cloud's points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, rotation_of_quaternion, se3, transform
from rhs.api.settings import near_file
from rhs.api.trajectory import check_unit, in_tum_order, in_unix_time, seconds_in

UNITS_S = {10: 1.0, 13: 1e-3, 16: 1e-6, 18: 1e-7, 19: 1e-9}  # digits of a time of these years in s, ms, us, 100 ns, ns
CLOUD_TIME = "cloud_time_s"
TIME_FIELDS = ("t", "time", "timestamp", "stamps", "time_stamp", "offset_time", "time_offset")  # as drivers call it
POINT_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
TURN_S = (0.01, 0.5)  # scanners turn 2 to 100 times a second, which tells the unit
OTHER_CLOCK_S = 1.0  # further than this from the cloud's stamp, times are of another clock


def ascending(stamps_s, max_jump_s: float) -> tuple[list[int], Counter]:
    """Indices of the stamps that are kept, in order of arrival, and how many were rejected and why.

    A stamp must be finite and later than the last one kept: a `duplicate` or `backward` stamp is rejected. One that
    leaps ahead by more than max_jump_s is rejected as an `outlier` when the next falls back behind it; when the clock
    goes on from there it is kept and counted as a `jump`. So intervals are always positive.
    """
    kept: list[int] = []
    counts: Counter = Counter()
    stamps = np.asarray(stamps_s, float)
    for i, stamp in enumerate(stamps):
        if not np.isfinite(stamp):
            counts["not_finite"] += 1
            continue
        last = stamps[kept[-1]] if kept else -np.inf
        if stamp == last:
            counts["duplicate"] += 1
        elif stamp < last:
            counts["backward"] += 1
        elif i + 1 < len(stamps) and stamp - stamps[i + 1] > max_jump_s:
            counts["outlier"] += 1
        else:
            counts["jump"] += int(bool(kept) and stamp - last > max_jump_s)  # json writes no number of NumPy
            kept.append(i)
    return kept, +counts


def in_file_order(stamps_s, max_jump_s: float) -> tuple[np.ndarray, Counter]:
    """Stamps that increase for views that are in order in their file, and how many were repaired and why.

    Some loggers write stamps that step back now and then though the file's order is right. A stamp that `ascending` would
    reject is put evenly between the ones around it; after the last good one it goes on at the usual pace."""
    stamps = np.asarray(stamps_s, float)
    kept, counts = ascending(stamps, max_jump_s)
    if not kept:
        return np.arange(len(stamps), dtype=float), Counter(not_finite=len(stamps))
    good = stamps[kept]
    pace_s = float(np.median(np.diff(good))) if len(kept) > 1 else 0.1
    places = np.arange(len(stamps))
    out: np.ndarray = np.interp(places, kept, good)
    out[: kept[0]] = good[0] - pace_s * (kept[0] - places[: kept[0]])
    out[kept[-1] + 1 :] = good[-1] + pace_s * (places[kept[-1] + 1 :] - kept[-1])
    return out, counts - Counter(jump=counts["jump"])


def in_order(stamps_s, max_jump_s: float) -> tuple[list[int], Counter]:
    """As `ascending` for a list that may have been written in any order: when more than half of it would be rejected as
    backward, it is put in order of time first, and all of it counted as `reordered`."""
    kept, counts = ascending(stamps_s, max_jump_s)
    if counts["backward"] <= len(stamps_s) // 2:
        return kept, counts
    order = np.argsort(np.asarray(stamps_s, float), kind="stable")
    kept, counts = ascending(np.asarray(stamps_s, float)[order], max_jump_s)
    return [int(order[i]) for i in kept], counts + Counter(reordered=len(stamps_s))


def associate(a_s: np.ndarray, b_s: np.ndarray, max_difference_s: float) -> list[tuple[int, int]]:
    """Pairs (i, j) of nearest stamps, one to one, closest pairs first (TUM's rule), sorted by i. O(n log n)."""
    order = np.argsort(b_s, kind="stable")
    sorted_b = b_s[order]
    slack = max_difference_s + 1e-9
    low = np.searchsorted(sorted_b, a_s - slack)
    high = np.searchsorted(sorted_b, a_s + slack, side="right")
    candidates = sorted(
        (abs(a_s[i] - sorted_b[j]), i, int(order[j])) for i in range(len(a_s)) for j in range(low[i], high[i])
    )
    used_a, used_b, pairs = set(), set(), []
    for _, i, j in candidates:
        if i not in used_a and j not in used_b:
            used_a.add(i)
            used_b.add(j)
            pairs.append((i, j))
    return sorted(pairs)


def rows(path, ordered: Callable[[str], str] = in_unix_time) -> list[tuple[int, list[str]]]:
    """(line number, words) of a text list; `#` begins a comment, commas count as spaces. ordered: the text as it is read."""
    out = []
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; is the recording of another form? (source.format=auto looks at the "
                          "files)") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: found {path.stat().st_size} bytes that are no text; expected lines of words") from None
    for number, line in enumerate(ordered(text).splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if words:
            out.append((number, words))
    return out


def number_of(text: str, where: str) -> float:
    """The number in `text`; ConfigError with the place otherwise."""
    try:
        return float(text)
    except ValueError:
        raise ConfigError(f"{where}: found {text[:40]!r} where a number was expected") from None


def seconds_of(text: str, where: str) -> float:
    """The stamp in `text`, seconds: 13, 16 and 19 digits (before a point) are a Unix time in ms, us and ns."""
    stamp = number_of(text, where)
    return stamp * seconds_in(stamp)


ROUNDED_S = 1e-3  # by which files that round them part two stamps of one view


@dataclass(frozen=True)
class Truth:
    """True poses world_from_camera (N, 4, 4) at ascending stamps (N,), seconds."""

    stamps_s: np.ndarray
    poses: np.ndarray
    max_gap_s: float
    rejected: Counter = field(default_factory=Counter)

    def at(self, stamp_s: float) -> np.ndarray | None:
        """The pose at a stamp: linear and spherical interpolation between neighbours; outside or in a gap that whose stamp
        differs by rounding alone, or None."""
        j = int(np.searchsorted(self.stamps_s, stamp_s))
        if j < len(self.stamps_s) and abs(self.stamps_s[j] - stamp_s) < 1e-9:
            return self.poses[j]
        if j == 0 or j == len(self.stamps_s) or self.stamps_s[j] - self.stamps_s[j - 1] > self.max_gap_s:
            near = next((k for k in (j - 1, j) if 0 <= k < len(self.stamps_s)
                         and abs(self.stamps_s[k] - stamp_s) <= ROUNDED_S), None)
            return None if near is None else self.poses[near]
        share = (stamp_s - self.stamps_s[j - 1]) / (self.stamps_s[j] - self.stamps_s[j - 1])
        return between(self.poses[j - 1], self.poses[j], share)


def between(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """The 4x4 pose at `share` (0..1) of the way from a to b, position and rotation apart."""
    from rhs.api.geometry import exp_so3, log_so3

    turn = log_so3((inverse(a) @ b)[:3, :3])
    return se3(a[:3, :3] @ exp_so3(share * turn), (1.0 - share) * a[:3, 3] + share * b[:3, 3])


def typed_truth(settings) -> Truth | None:
    """The poses of `source.truth`, or None where none was typed."""
    return read_tum_truth(typed_file(settings.truth), settings) if settings.truth else None


def typed_file(name: str) -> Path:
    """The file of true poses that was typed. Raises ConfigError where there is none."""
    path = Path(name).expanduser()
    if not path.is_file():
        raise ConfigError(f"source.truth={name}: no such file{near_file(path)}; expected stamp tx ty tz qx qy qz qw a "
                          "line")
    return path


def read_tum_truth(path, settings) -> Truth:
    """A TUM trajectory (stamp tx ty tz qx qy qz qw, or as a header names them) as Truth; poses that hold NaN or infinity are
    counted and left out. Raises ConfigError with file and line."""
    stamps, poses, unknown = [], [], 0
    for number, words in rows(path, lambda text: in_tum_order(text, str(path))):
        where = f"{path.name}:{number}"
        if len(words) != 8:
            raise ConfigError(f"{where}: found {len(words)} columns; expected stamp tx ty tz qx qy qz qw")
        values = [seconds_of(words[0], where), *(number_of(w, where) for w in words[1:])]
        if not np.all(np.isfinite(values)):  # how some systems write that they saw nothing
            unknown += 1
            continue
        check_unit(values[4:], where)
        try:
            poses.append(se3(rotation_of_quaternion(np.array(values[4:])), np.array(values[1:4])))
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None
        stamps.append(values[0])
    kept, rejected = in_order(stamps, settings.max_jump_s)
    rejected = rejected + Counter(unknown=unknown)
    return Truth(np.array(stamps)[kept], np.array(poses).reshape(-1, 4, 4)[kept], settings.max_truth_gap_s, rejected)


def seconds_after(stamp_s: float, times: np.ndarray) -> np.ndarray | None:
    """When each point of a turning lidar's cloud was seen, (N,) float32 seconds after the stamp of the cloud.

    times (N,): as a driver wrote them, since the stamp, or since 1970 by its clock; where that is another clock, the first
    point is taken to be of the stamp. None where they are no times of one turn."""
    times = np.asarray(times, float)
    if not len(times) or not np.isfinite(times).all():
        return None
    first = times.min()
    unit = next((unit for unit in POINT_UNITS_S if TURN_S[0] <= (times.max() - first) * unit <= TURN_S[1]), None)
    if unit is None:
        return None
    for begin in (0.0, stamp_s / unit):
        after = (times - begin) * unit
        if np.abs(after).max() <= OTHER_CLOCK_S:
            return after.astype(np.float32)
    return ((times - first) * unit).astype(np.float32)


def cloud_extras(points: np.ndarray, times: np.ndarray | None, stamp_s: float,
                 body_from_cloud: np.ndarray | None) -> dict[str, np.ndarray]:
    """The extra modalities of a cloud (N, 3) in its own frame: `cloud`, in the body's, and its `cloud_time_s` if known."""
    placed = points if body_from_cloud is None else transform(body_from_cloud, points.astype(float))
    after = None if times is None else seconds_after(stamp_s, times)
    return {"cloud": placed.astype(np.float32)} | ({} if after is None else {CLOUD_TIME: after})
