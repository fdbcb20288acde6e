"""A patrol told to a person, from the files of its folder: what happened, what changed where, how sure the robot was."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.records import BeliefStatus
from rhs.metrics.patrol import arrived_elsewhere, patrol_steps
from rhs.runfolder.run import Run

COLOURS_BGR = {"new": (40, 40, 220), "gone": (220, 90, 30), "looks different": (0, 200, 240)}
SHOWN_PX = 480  # width of each picture on the page
JPEG_QUALITY = 85
SURE_M, SURE_RAD = 0.1, np.radians(3.0)  # up to twice this error is what the page calls sure


@dataclass(frozen=True)
class PlaceStory:
    """title: the place; found: what changed, in words; pictures: a data address, or nothing; sure: how sure of the pose."""

    title: str
    found: str
    pictures: str
    sure: str


@dataclass(frozen=True)
class Story:
    """lines: what happened; places: one for each place reached, then one for each view on the way that shows a change."""

    lines: tuple[str, ...]
    places: tuple[PlaceStory, ...]


def patrol_story(folder: Path, row: Mapping[str, Any]) -> Story:
    """The story of a run folder that has a changes.json."""
    run = Run(folder)
    missions, rows, patrol = run.json("missions") or [], run.json("changes") or [], patrol_steps(run)
    places = tuple(_place(folder, row) for row in rows)
    mistaken = arrived_elsewhere(missions, patrol)
    return Story((*_what_happened(missions, rows, mistaken), *_of_the_row(row), *_of_the_steps(patrol)), places)


def _changed(rows: list[dict[str, Any]]) -> str:
    """What was found changed at the places, of those that could be compared with the survey."""
    way, rows = [row for row in rows if row.get("on_way")], [row for row in rows if not row.get("on_way")]
    changed, compared = ([row["picture"][3:] for row in rows if row[key]] for key in ("changes", "before"))
    if changed or way:
        where = [f"at {', '.join(changed)}"] * bool(changed) + [f"on the way, in {_count(len(way), 'view')}"] * bool(way)
        return f"Something changed {' and '.join(where)}."
    if not compared:
        return "None of them could be compared with the survey."
    return "Nothing was found changed " + ("at any of them." if len(compared) == len(rows) else f"at {', '.join(compared)}.")


def _what_happened(missions: list[dict[str, Any]], rows: list[dict[str, Any]], mistaken: Mapping[str, float]) -> list[str]:
    reached = [m["place"] for m in missions if m["status"] == "arrived" and str(m["mission"]) not in mistaken]
    given_up = [m for m in missions if m["status"] == "gave_up"]
    lines = [f"The robot reached {_count(len(reached), 'place')}: {', '.join(reached) or 'none'}."]
    lines += [f"It was mistaken when it said that it had reached {m['place']}: it stood {off_m:.1f} m from it."
              for m in missions if (off_m := mistaken.get(str(m["mission"]))) is not None]
    lines.append(_changed(rows))
    lines += [f"It gave {m['place']} up: {m['reason']}." for m in given_up]
    lines += [f"On the way to {m['place']} something stood in the way: {m['reason']}; it set out anew." for m in missions
              if m["status"] == "aborted"]
    lines += [f"It put {m['place']} off: {m['reason']}." for m in missions if m["status"] == "skipped"]
    lines += [f"On the way to {m['place']} it planned anew {_times(m['replans'])}." for m in missions if m["replans"]]
    return lines


def _of_the_row(row: Mapping[str, Any]) -> list[str]:
    kidnaps, collisions = row.get("kidnaps") or 0, row.get("collisions")
    lines = [f"It was carried elsewhere {_times(int(kidnaps))}."] if kidnaps else []
    if isinstance(collisions, int | float) and collisions == collisions:
        lines.append("It touched nothing." if not collisions else f"It touched something {_times(int(collisions))}.")
    return lines


def _of_the_steps(patrol: Sequence[Mapping[str, str]]) -> list[str]:
    """How long it did not know where it was."""
    if not patrol:
        return []
    on_map = {status for status in BeliefStatus if status.on_map}
    lost = sum(row["belief_status"] not in on_map for row in patrol)
    bent = sum(row["belief_status"] == BeliefStatus.DEGRADED for row in patrol)
    lines = [f"In {lost} of {len(patrol)} views it did not know where it was."] if lost else \
        [f"It knew where it was in all {len(patrol)} views."]
    return [*lines, f"In {bent} of them it knew its place on its map, which may be bent there."] if bent else lines


def _place(folder: Path, row: dict[str, Any]) -> PlaceStory:
    turn_deg = np.degrees(row["sigma_yaw_rad"])
    sure = row["sigma_m"] <= SURE_M and row["sigma_yaw_rad"] <= SURE_RAD
    where = f"({row['x_m']:.2f}, {row['y_m']:.2f}) m, looking {np.degrees(row['yaw_rad']):.0f} degrees"
    words = f"The robot was {'sure' if sure else 'not sure'} of where it stood: {where}, give or take " \
            f"{100 * row['sigma_m']:.1f} cm and {turn_deg:.1f} degrees (1 sigma)."
    title = f"On the way, near ({row['x_m']:.1f}, {row['y_m']:.1f}) m" if row.get("on_way") else row["picture"][3:]
    return PlaceStory(title, _found(row), _pictures(folder, row), words)


def _found(row: dict[str, Any]) -> str:
    if not row["before"]:
        return "Not compared: no picture of the survey shows what the robot saw here, or there is no depth."
    if not row["changes"]:
        return "Nothing changed."
    return "; ".join(f"{c['verdict']}: {c['width_m']:.2f} m wide, {c['height_m']:.2f} m high, near ({c['at_m'][0]:.1f}, "
                     f"{c['at_m'][1]:.1f}) m" for c in row["changes"]) + "."


def _pictures(folder: Path, row: dict[str, Any]) -> str:
    """Now and before, side by side, what changed outlined; a JPEG as a data address. Empty without pictures."""
    import cv2

    now_in, before_in = ("on_way", "on_way") if row.get("on_way") else ("places", "places_before")
    path = folder / now_in / f"{row['picture']}.png"
    now = cv2.imread(str(path)) if path.is_file() else None  # a laser takes no pictures
    if now is None:
        return ""
    shown = [_outlined(now, row["width_px"], [(c["verdict"], c["outline_px"]) for c in row["changes"]])]
    for number in _telling(row):
        image = cv2.imread(str(folder / before_in / f"{row['before'][number]}.png"))
        if image is not None:
            shown.append(_outlined(image, row["width_px"], [(c["verdict"], c["before_px"][number]) for c in row["changes"]]))
    height = min(image.shape[0] for image in shown)
    rim = np.full((height, 6, 3), 255, np.uint8)
    strip = np.hstack([part for image in shown for part in (image[:height], rim)][:-1])
    ok, data = cv2.imencode(".jpg", strip, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}" if ok else ""


def _telling(row: dict[str, Any]) -> list[int]:
    """The first picture before, and for each change the one that shows most of it; two at most."""
    wanted = [max(range(len(row["before"])), key=lambda k: _extent(change["before_px"][k])) for change in row["changes"]
              if row["before"]]
    numbers = list(dict.fromkeys([*wanted, 0])) if row["before"] else []
    return numbers[:2]


def _extent(outline: list[list[float]]) -> float:
    return float(np.prod(np.ptp(np.array(outline), axis=0))) if len(outline) else 0.0


def _outlined(image: np.ndarray, width_px: int, outlines: list[tuple[str, list[list[float]]]]) -> np.ndarray:
    """The picture at the width of the page, with outlines given in pixels of one `width_px` wide."""
    import cv2

    large: np.ndarray = cv2.resize(image, (SHOWN_PX, round(image.shape[0] * SHOWN_PX / image.shape[1])),
                                   interpolation=cv2.INTER_CUBIC)
    for verdict, outline in outlines:
        if len(outline) >= 3:
            points = (np.array(outline) + 0.5) * SHOWN_PX / width_px - 0.5
            cv2.polylines(large, [np.rint(points).astype(np.int32)], True, COLOURS_BGR[verdict], 2, cv2.LINE_AA)
    return large


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
