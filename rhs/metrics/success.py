"""Did a run do what it was asked to do? Apart from `status`, which only says that the program ended well.

Planning: a path was found and the judge holds it valid. Patrol: every place was visited that
a robot of its size may get to, as things then stood. Survey or recording: at least
half of the views arrived, the odometry tracked at least half of these, and the map of a laser neither contradicts itself nor
is unsure of its way; unrolling: at least half of the strips were registered.
Localise: a laser that sits as was told, a map as large as the building, found after nine of ten starts, wrong and sure in
1 % of the views at most.
A run that was asked for nothing (single places queried, a figure only) neither succeeded nor failed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

NAN = float("nan")
# A majority: a trajectory that is unknown in most of its views is no trajectory, however good the rest is.
HALF = 0.5
# Right maps have 0.00 to 0.03 (two real buildings, made ones), those with a part in a wrong place mostly 0.05 and more.
CONTRADICTED = 0.04
# Closed loops leave 0.1 to 0.4 m; where scans see nothing along the way and no loop is found it is many metres.
UNSURE_M = 0.5
# Wheels are worn and slip by some hundredths; a diameter or a track that was set wrong is hardly off by so much.
WHEELS_OFF = 1.7
# Asked of task=localise: found within 10 m of way after so many of the starts, wrong and sure in at most so many views.
FOUND, WRONG_AND_SURE = 0.9, 0.01


def success_of(row: Mapping[str, object]) -> tuple[float, str]:
    """(1.0, ""), (0.0, why not) or (NaN, "") of one row."""
    if row.get("status") != "ok":
        return 0.0, _text(row.get("reason")) or _text(row.get("status")) or "no status"
    if row.get("task") == "planning" or _known(row, "plan_success"):
        return _planned(row)
    if row.get("task") == "localise":
        return _localised(row)
    if _number(row, "places_total") > 0 and row.get("task") not in ("survey", "explore"):
        return _visited(row)
    views, lost = _number(row, "views"), _number(row, "views_lost")
    if lost > HALF * (views + lost):
        return 0.0, f"{lost:.0f} of {views + lost:.0f} views never arrived"
    if wrong := mount_fault(row) or ("" if vision_led(row) else wheel_fault(row) or late_views(row)):
        return 0.0, wrong
    if _number(row, "map_inconsistency") > CONTRADICTED:
        return 0.0, f"the map reads wrong: beams look through {_number(row, 'map_inconsistency'):.0%} of its walls"
    if _number(row, "way_sigma_m") > UNSURE_M:
        return 0.0, f"the way is unsure by {_number(row, 'way_sigma_m'):.2g} m (1 sigma): scans and loops hold it too little"
    for name, what in (("tracked_share", "tracked in {:.0%} of the views"),
                       ("strips_registered_share", "{:.0%} of the strips registered")):
        if _known(row, name):
            share = _number(row, name)
            return (1.0, "") if share >= HALF else (0.0, what.format(share))
    return NAN, ""


def mount_fault(row: Mapping[str, object]) -> str:
    """How the laser sits otherwise than was told, and what to type; empty where it does not."""
    roll, yaw = _number(row, "mount_roll_off_deg"), _number(row, "mount_yaw_off_deg")
    if not (roll or yaw) or math.isnan(roll + yaw):
        return ""
    how = " and ".join(words for words, off in (("upside down", roll), (f"turned by {yaw:.0f} degrees", yaw)) if off)
    wheels = "; if the wheels count right turns as left (NED axes), source.wheel_topic=none, else the map is a mirror's"
    return (f"by its scans and the wheels the laser is mounted {how}, which nobody told; type "
            f"source.scan_mount=[0,0,0,{roll:.0f},0,{yaw:.0f}], or turn the mount that was told by so much"
            f"{wheels if roll else ''}")


def wheel_fault(row: Mapping[str, object]) -> str:
    """How wheels contradict what a camera saw, and what to type; empty where they do not."""
    for name, what, why in (("wheel_way_ratio", "way", "another unit, a wrong source.depth_scale"),
                            ("wheel_turn_ratio", "turn", "another sign or unit")):
        ratio = _number(row, name)
        if not math.isnan(ratio) and not 1.0 / WHEELS_OFF < ratio < WHEELS_OFF:
            return (f"the wheels tell of {ratio:.2g} times the {what} that the camera saw: {why}, or a camera that sits "
                    "otherwise than was told; type source.wheel_topic=none to go without wheels")
    return ""


def late_views(row: Mapping[str, object]) -> str:
    """How much later the views are stamped than the wheels' readings, and what to type; empty where they are not."""
    late_s = _number(row, "views_late_s")
    if math.isnan(late_s) or late_s == 0.0:
        return ""
    side = "after" if late_s > 0.0 else "before"
    return (f"by their turns the views come {abs(late_s):.2g} s {side} the wheels' readings "
            f"(of a bag: source.views_late_s={late_s:.2g}, or so much more than was typed, puts it right)")


def vision_led(row: Mapping[str, object]) -> bool:
    """Whether the way is the camera's alone, and the wheels for sure what is wrong: they turn by another share than it saw,
    which no scale of depth explains, and not the other way round, as those beside a camera that hangs upside down."""
    turn = _number(row, "wheel_turn_ratio")
    off = not math.isnan(turn) and not 1.0 / WHEELS_OFF < turn < WHEELS_OFF
    return off and not -WHEELS_OFF < turn < -1.0 / WHEELS_OFF and _number(row, "gated_share") == 0.0


def with_success(row: Mapping[str, object]) -> dict[str, object]:
    """The row with its columns `success` and `failure`."""
    success, failure = success_of(row)
    return {**row, "success": success, "failure": failure}


def _planned(row: Mapping[str, object]) -> tuple[float, str]:
    if _number(row, "plan_success") != 1.0:
        return 0.0, _text(row.get("plan_reason")) or "no path"
    return (1.0, "") if _number(row, "plan_valid") == 1.0 else (0.0, _text(row.get("plan_failure")) or "invalid path")


def _localised(row: Mapping[str, object]) -> tuple[float, str]:
    """Found after nine of ten starts, and hardly ever wrong and sure of it; without a truth not where it says itself that it
    is lost most of the time, else unknown."""
    if fault := mount_fault(row):
        return 0.0, fault
    if _known(row, "map_size_ratio") and _number(row, "map_size_ratio") != 1.0:
        return 0.0, (f"the map is {_number(row, 'map_size_ratio'):.3f} times as large as what the odometry measures: is the "
                     "resolution in its yaml right?")
    if not _known(row, "found_share"):
        lost = _number(row, "belief_lost_share")
        return (0.0, f"lost in {lost:.0%} of the views") if lost > HALF else (NAN, "")
    if _number(row, "found_share") < FOUND:
        return 0.0, f"found itself after {_number(row, 'found_share'):.0%} of {_number(row, 'starts'):.0f} starts"
    wrong = _number(row, "belief_wrong_sure_share")
    return (1.0, "") if wrong <= WRONG_AND_SURE else (0.0, f"wrong and sure of it in {wrong:.1%} of the views")


def _visited(row: Mapping[str, object]) -> tuple[float, str]:
    within, visited = places_within_reach(row), _number(row, "places_visited")
    if visited >= within:
        return 1.0, ""
    barred = "" if within == _number(row, "places_total") else " that can be reached"
    return 0.0, f"{0 if math.isnan(visited) else visited:.0f} of {within:.0f} places{barred}"


def places_within_reach(row: Mapping[str, object]) -> float:
    """How many places the robot surely or perhaps gets to; all of them where nobody knows, NaN where none was asked."""
    total, surely, perhaps = (_number(row, f"places_{name}") for name in ("total", "reachable", "undecided"))
    return total if math.isnan(surely + perhaps) else surely + perhaps


def _number(row: Mapping[str, object], name: str) -> float:
    try:
        return float(row.get(name))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return NAN


def _known(row: Mapping[str, object], name: str) -> bool:
    return not math.isnan(_number(row, name))


def _text(value: object) -> str:
    return value if isinstance(value, str) else ""
