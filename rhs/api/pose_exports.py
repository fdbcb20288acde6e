"""Poses as other programs export them, turned into lines of a TUM file: OptiTrack's Motive (.csv), Qualisys's 6D tables
(.tsv), kapture's trajectories.txt, COLMAP's images.txt, ARKitScenes' .traj, and the JSON of Nerfstudio, ScanNet++, Record3D,
Open3D and nuScenes.

What each means by a pose: Motive (docs.optitrack.com, Data Export: CSV) has y up, here turned to z, for the body too, as its
ROS drivers do; Qualisys millimetres, the rotation column by column (Rot[1] is y by x, as the angles beside it show), and
zeros of a body that was not seen; kapture (kapture_format.adoc), COLMAP and ARKitScenes (TrajStringToMatrix) the world in
the camera; Nerfstudio and Record3D cameras that look along -z with y up, here turned. Where a file has no stamps, the
numbers of its images stand in their place.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rhs.base.errors import RecordingError

from .geometry import inverse, quaternion_xyzw, rotation_of_quaternion, se3

UNITS_M = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001}
NO_UNIT = 0.01  # by which four numbers that are no quaternion are longer or shorter than one
LAST_ROW, SKEW = (0.0, 0.0, 0.0, 1.0), 0.05  # of a 4x4 pose; by which a rotation in a file may be off
QUALISYS = ("NO_OF_FRAMES", "FILE_VERSION")  # how its tables begin
COLMAP, COLMAP_WORDS = "QW, QX, QY, QZ, TX, TY, TZ", 10  # in its head; in the line of an image
_IN_NAME = re.compile(r"(\d+(?:\.\d+)?)\.[A-Za-z]+$")
FLIPPED = np.diag([1.0, -1.0, -1.0, 1.0])  # optical axes seen from a camera of OpenGL
_TABLE = "write it as lines of `stamp x y z qx qy qz qw` (seconds, metres)"
_ARRAY = "python -c \"import numpy as n; a=n.load('{file}'); n.savetxt('way.txt', a.reshape(len(a), -1))\""
_BAG = "a bag: evo_traj bag2 {file} /TOPIC --save_as_tum (ROS 1: bag; pip install evo)"
OTHERS = {  # by the ending, or the first word
    ".bag": _BAG, ".mcap": _BAG, ".db3": _BAG, ".npy": f"arrays: {_ARRAY} (x y z qx qy qz qw, or 12 or 16 numbers, a line)",
    ".npz": f"arrays: {_TABLE}", ".c3d": f"markers: export the rigid body from the capture's program and {_TABLE}",
    ".bin": "numbers, not text; of COLMAP: colmap model_converter --input_path . --output_path . --output_type TXT",
    ".gpx": f"positions of GPS: {_TABLE}, east, north and up in metres, and 0 0 0 1",
    "Objects": f"a table of Vicon, whose RX RY RZ are a rotation vector or angles as it was set: {_TABLE}",
    "FLASER": "a laser log: python -m rhs source=replay source.path={file} leaves corrected.tum and truth_survey.tum",
}
OTHERS |= {"Segments": OTHERS["Objects"], **dict.fromkeys((".kml", ".nmea", "$GPGGA", "$GNGGA", "$GPRMC"), OTHERS[".gpx"])}
OTHERS |= dict.fromkeys(("ODOM", "ROBOTLASER1", "RAWLASER1", "PARAM", "TRUEPOS"), OTHERS["FLASER"])
_ADJUSTED = re.compile(r"\d+ \d+ \d+\n\d+ \d+ +-?\d+\.")  # the head and the first observation of a BAL problem


def joined(table: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Of poses (number, words) whose matrices stand row by row in lines of four numbers, three lines each (SUN3D) or four
    (NumPy, Neural RGB-D), a row of twelve or sixteen each; another table as it is."""
    if {len(words) for _, words in table} != {4}:
        return table
    try:
        rows = np.array([words for _, words in table], float)
    except ValueError:
        return table
    whole = len(rows) % 4 == 0 and bool((np.isnan(rows[3::4]) | (rows[3::4] == LAST_ROW)).all())
    count = 4 if whole else 3
    turns = rows[: len(rows) // count * count].reshape(-1, count, 4)[:, :3, :3]
    known = turns[np.isfinite(turns).all(axis=(1, 2))]
    if len(rows) % count or not len(known) or np.abs(known[0] @ known[0].T - np.eye(3)).max() > SKEW:
        return table
    return [(table[k][0], [word for _, words in table[k : k + count] for word in words]) for k in range(0, len(rows), count)]


def advice_for(where: str, first: str = "") -> str:
    """What makes a trajectory of a file by its name, or the first word in it; empty where nobody knows."""
    path = Path(where)
    return OTHERS.get(first, OTHERS.get(path.suffix.lower(), "")).format(file=path.name)


def exported(text: str, where: str) -> str | None:
    """The lines of a TUM file of such an export; None of another text. where: its file. Raises RecordingError."""
    first = re.split(r"[\s,]", text[:40].lstrip(), maxsplit=1)[0]
    advice = advice_for(where, first)
    if not advice and _ADJUSTED.match(text):
        advice = f"a problem of bundle adjustment (BAL), whose cameras have no times: {_TABLE}"
    if advice:
        raise RecordingError(f"{where}: found {advice}")
    try:
        if text.startswith("Format Version"):
            return "\n".join(_of_motive([*csv.reader(text.splitlines())]))
        if first.startswith(("{", "[")):
            known = sorted(_of_json(json.loads(text)), key=lambda one: float(one[0]))
            return "\n".join(_line(stamp, pose) for stamp, pose in known)
        if text.startswith("# kapture format"):
            return "\n".join(_of_kapture(text))
        if first in QUALISYS:
            return "\n".join(_of_qualisys([line.split("\t") for line in text.splitlines()]))
        if COLMAP in text:
            return "\n".join(_of_colmap(text))
        if where.endswith(".traj") and _is_arkit(text):
            return "\n".join(map(_of_rotation_vector, text.splitlines()))
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, StopIteration, RecursionError) as error:
        said = " ".join(str(error).split())[:160]
        raise RecordingError(f"{where}: poses that cannot be read: {said or type(error).__name__}") from None
    return None


def _line(stamp: str, pose: np.ndarray) -> str:
    return f"{stamp} " + " ".join(f"{v:.9f}" for v in (*pose[:3, 3], *quaternion_xyzw(pose[:3, :3])))


def _posed(quaternion_xyzw: Any, place: Any) -> np.ndarray:
    return se3(rotation_of_quaternion(np.array(quaternion_xyzw, float)), np.array(place, float))


def _of_motive(table: list[list[str]]) -> Iterator[str]:
    """Of the one rigid body in a table of Motive; an empty cell means that it was not seen."""
    said = dict(zip(table[0][::2], table[0][1::2], strict=False))
    begin = next(k for k, row in enumerate(table) if row[:1] == ["Frame"])
    kinds, names, *_, what = [row for row in table[1:begin] if any(row)]
    of = {(names[k], what[k], axis): k for k, axis in enumerate(table[begin]) if k < len(kinds) and kinds[k] == "Rigid Body"}
    bodies = sorted({name for name, *_ in of})
    if len(bodies) != 1 or said["Rotation Type"] != "Quaternion":
        raise ValueError(f"{len(bodies)} rigid bodies of Motive ({', '.join(bodies[:4])}), rotations as "
                         f"{said['Rotation Type']}; expected one, as Quaternion: export that alone")
    columns = [of[bodies[0], "Position", axis] for axis in "XYZ"] + [of[bodies[0], "Rotation", axis] for axis in "XYZW"]
    unit_m = UNITS_M[said["Length Units"].lower()]
    for row in table[begin + 1 :]:
        cells = [row[k] for k in columns] if len(row) > max(columns) else [""]
        if not all(cells):
            yield f"{row[1]}{' nan' * 7}" if len(row) > 1 else ""
            continue
        x, y, z, qx, qy, qz, qw = map(float, cells)
        yield f"{row[1]} " + " ".join(f"{v:.9f}" for v in (x * unit_m, -z * unit_m, y * unit_m, qx, -qz, qy, qw))


def _of_kapture(text: str) -> Iterator[str]:
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    rows = [row for row in rows if len(row) == 9]  # a part of a pose is none
    if len(devices := sorted({row[1] for row in rows})) > 1:
        raise ValueError(f"of {len(devices)} devices of kapture ({', '.join(devices[:4])}); expected the lines of one")
    for stamp, _, w, x, y, z, *place in rows:
        yield _line(stamp, inverse(_posed([x, y, z, w], place)))


def _of_qualisys(table: list[list[str]]) -> Iterator[str]:
    """Of the one rigid body in a table of QTM; one that was not seen is written as zeros."""
    said = {row[0]: row[1:] for row in table if row}
    begin = next((k for k, row in enumerate(table) if "Rot[0]" in row), None)
    if begin is None or said.get("NO_OF_BODIES", ["1"])[0] != "1":
        found = f"{said['NO_OF_BODIES'][0]} rigid bodies" if begin is not None else "no rigid body"
        raise ValueError(f"{found} of Qualisys ({' '.join(said.get('DATA_INCLUDED', ['?']))} data); expected one: export "
                         "its 6DOF data alone (TSV, 6D)")
    names = table[begin]
    x, rot = next(k for k, name in enumerate(names) if name.split(" ")[-1] == "X"), names.index("Rot[0]")
    rate_hz = float(said["FREQUENCY"][0])
    for number, row in enumerate(row for row in table[begin + 1 :] if any(row)):
        stamp = row[names.index("Time")] if "Time" in names else f"{number / rate_hz:.6f}"
        place, turn = np.array(row[x : x + 3], float), np.array(row[rot : rot + 9], float)
        if turn.any():
            yield _line(stamp, se3(turn.reshape(3, 3).T, 1e-3 * place))
        else:
            yield f"{stamp}{' nan' * 7}"


def _of_colmap(text: str) -> Iterator[str]:
    """Of an images.txt: the cameras' poses by the numbers in the images' names, which are stamps where they are times."""
    rows = [line.split() for line in text.splitlines() if not line.startswith("#")]
    images = [(row, name[1]) for row in rows if len(row) == COLMAP_WORDS and not row[-1].lstrip("-").isdigit()
              and (name := _IN_NAME.search(row[-1]))]  # others are the points of an image
    if not images:
        raise ValueError("no image of COLMAP with a number in its name; expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID "
                         "NAME")
    for (_, w, x, y, z, *place, _, _), stamp in sorted(images, key=lambda one: float(one[1])):
        yield _line(stamp, inverse(_posed([x, y, z, w], place)))


def _is_arkit(text: str) -> bool:
    """Whether the lines have seven numbers, and the last four are no quaternions."""
    rows = [line.split() for line in text.splitlines() if line.strip()]
    if {len(row) for row in rows} != {7}:
        return False
    return bool((np.abs(np.linalg.norm(np.array(rows, float)[:, 3:], axis=1) - 1.0) > NO_UNIT).any())


def _of_rotation_vector(line: str) -> str:
    from scipy.spatial.transform import Rotation

    stamp, *numbers = line.split() or [""]
    if not numbers:
        return ""
    turn, place = np.array(numbers, float).reshape(2, 3)
    return _line(stamp, inverse(se3(Rotation.from_rotvec(turn).as_matrix(), place)))


def _of_json(plain: Any) -> Iterator[tuple[str, np.ndarray]]:
    """(stamp, pose) of each entry."""
    kind = plain.get("class_name", "") if isinstance(plain, dict) else ""
    if isinstance(plain, list):  # nuScenes' ego_pose.json
        for one in plain:
            w, *xyz = one["rotation"]
            yield str(one["timestamp"]), _posed([*xyz, w], one["translation"])
    elif kind == "PinholeCameraTrajectory":
        for k, one in enumerate(plain["parameters"]):
            yield str(k), inverse(np.array(one["extrinsic"], float).reshape(4, 4).T)
    elif kind == "PoseGraph":
        for k, one in enumerate(plain["nodes"]):
            yield str(k), np.array(one["pose"], float).reshape(4, 4).T
    elif "frames" in plain:
        for one in plain["frames"]:
            yield _number(one["file_path"]), np.array(one["transform_matrix"], float).reshape(4, 4) @ FLIPPED
    elif "poses" in plain:  # Record3D's metadata
        for k, (*turn, x, y, z) in enumerate(plain["poses"]):
            yield str(k), _posed(turn, [x, y, z]) @ FLIPPED
    else:  # ScanNet++
        for name, one in plain.items():
            yield _number(name), np.array(one.get("aligned_pose", one["pose"]), float).reshape(4, 4)


def _number(name: str) -> str:
    return str(re.findall(r"\d+", Path(name).stem)[-1])
