"""TUM RGB-D folders: rgb.txt and depth.txt (or associations.txt, or rgb.txt alone: one camera), images, groundtruth.txt.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012. Depth 5000 = 1 m, 0 = unknown. OpenLORIS
calls its lists color.txt and aligned_depth.txt, and its 1000 is 1 m.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, planar
from rhs.api.records import Capture, WorldFacts
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE

from .folders.intrinsics import depth_scale_said, intrinsics_beside
from .folders.loris import base_from_color, wheels
from .folders.stereo_tum import Second, check_second, second_camera
from .replay_cameras import BONN_AXES, BONN_MARKERS, chosen_camera
from .replay_images import check_depth, check_pair, hint_scale, read_color, read_depth
from .replay_mounts import placed_camera
from .replay_register import DepthCamera, typed_depth_camera
from .replay_stamps import Truth, associate, in_order, read_tum_truth, rows, seconds_of, typed_file

log = logging.getLogger("rhs.replay")
UNREADABLE = "unreadable"  # of Recording.rejected: views whose files or messages hold no image
SET_BACK = "of_a_clock_set_back"  # views of a bag whose stamps step back further than messages overtake one another
ALIGNED = "aligned_depth.txt"
BONN = "rgbd_bonn"  # names of its folders begin so
COLORS, DEPTHS = ("rgb.txt", "color.txt"), (ALIGNED, "depth.txt")


@dataclass(frozen=True)
class Recording:
    """What a format hands to the source: its camera, the views with their true poses (None unknown), its counts, and
    what its views hold."""

    camera: Camera
    views: Iterator[tuple[Capture, np.ndarray | None]]
    total: int | None
    rejected: Counter
    facts: WorldFacts | None = None
    provides: frozenset[str] = frozenset({"image", "gray", "depth"})
    lost: list[str] = field(default_factory=list)  # filled while reading: what a damaged file no longer holds
    repaired: Counter = field(default_factory=Counter)  # stamps that were put right, and why; their views are kept
    timed: bool = True  # False: nobody says when its views were taken
    right: Camera | None = None  # whose images travel beside those of the camera


def is_tum(path: Path) -> bool:
    return any((path / name).is_file() for name in (*COLORS, *DEPTHS)) or _associated(path) is not None


def _associated(path: Path) -> Path | None:
    """The only list of pairs: associations.txt, or what else people call it (associated.txt of ETH3D, assoc.txt)."""
    found = list(path.glob("*assoc*.txt"))
    return found[0] if len(found) == 1 else next((file for file in found if file.name == "associations.txt"), None)


def open_tum(path: Path, settings) -> Recording:
    """The paired views of a TUM folder in order of time. Raises ConfigError when something is missing."""
    if settings.stereo:
        check_second(path)
    pairs, rejected = _pairs(path, settings)
    if not pairs:
        raise ConfigError(
            f"{path}: no colour and depth image within {settings.max_difference_s:g} s of each other;"
            " type source.max_difference_s=SECONDS"
        )
    truth_file = _truth_file(path, settings)
    truth = None if truth_file is None else read_tum_truth(truth_file, settings)
    if truth is not None and not settings.truth and path.resolve().name.startswith(BONN):
        truth = replace(truth, poses=inverse(BONN_AXES) @ truth.poses @ BONN_AXES @ BONN_MARKERS)
    place = base_from_color(path)  # OpenLORIS's true poses are those of its robot
    if place is not None and truth is not None:
        truth = replace(truth, poses=truth.poses @ place)
    if truth is not None:
        rejected = rejected + Counter({f"truth_{k}": v for k, v in truth.rejected.items()})
        _say_apart(truth, pairs, truth_file)
    scale = 1000.0 if (path / ALIGNED).is_file() else 5000.0
    return open_pairs(pairs, settings, truth=truth, default_scale=scale, rejected=rejected,
                      depth_camera=typed_depth_camera(settings.depth_camera), place=place,
                      odometry=None if place is None else wheels(path, settings),
                      second=second_camera(path, pairs[0][1]) if settings.stereo else None)


def _say_apart(truth: Truth, pairs: list[tuple[float, Path, Path | None]], file: Path | None) -> None:
    """Says so where no view lies within the time of the true poses: another clock, or another recording's."""
    first, last = pairs[0][0], pairs[-1][0]
    if len(truth.stamps_s) and (truth.stamps_s[0] > last or truth.stamps_s[-1] < first):
        log.warning("%s: its poses, of %.3f to %.3f s, are of none of the views, of %.3f to %.3f s; no error is known",
                    file, truth.stamps_s[0], truth.stamps_s[-1], first, last)


def open_pairs(pairs, settings, *, truth: Truth | None, default_scale: float, rejected: Counter,
               depth_camera: DepthCamera | None = None, timed: bool = True, place: np.ndarray | None = None,
               odometry: Truth | None = None, second: Second | None = None) -> Recording:
    """A Recording of (stamp, colour path, depth path or None) triples; the first pair is read at once, to refuse early.

    Later views that cannot be read are left out and said to be lost. depth_camera: took the depth images, and they are as
    it saw them; None: they are registered to colour. place: 4x4 body_from_camera where the recording says it; odometry: of
    its wheels. second: the right camera, whose images have the names of the left ones."""
    folder, registered, deep = Path(settings.path).expanduser(), depth_camera is None, pairs[0][2] is not None
    said = settings.depth_scale or (depth_scale_said(folder, settings.camera) if deep else None)
    scale = said or default_scale
    first = _read(pairs[0], scale, settings, registered)
    checked = not deep or _check_scale(pairs[0][2], scale, settings)
    size = (first[0].shape[1], first[0].shape[0])
    recorded = intrinsics_beside(folder, size) if settings.camera == "auto" else None
    camera = chosen_camera(settings.camera, size, recorded=recorded, where=str(folder))
    camera = placed_camera(camera if place is None else replace(camera, body_from_camera=place), settings)
    wanted = pairs[settings.start :: settings.stride][: settings.count or None]
    if not wanted:
        raise ConfigError(f"{folder}: source.start={settings.start} but the recording has {len(pairs)} views")

    right = None if second is None else second.beside(camera)
    if deep and not said:
        hint_scale([depth for *_, depth in wanted], scale=scale, where=folder.name)
    lost: list[str] = []
    listed = [(stamp, str(color), str(depth or "")) for stamp, color, depth in wanted]  # paths take 2 kB a view

    def views():
        index, sound, before = 0, checked, None
        for stamp, *files in listed:
            pair = stamp, *(Path(file) if file else None for file in files)
            try:
                color, depth = _read(pair, scale, settings, registered)
                extras = {} if second is None or right is None else second.seen(pair[1], right)
            except ConfigError as error:  # the first pair was read before
                rejected[UNREADABLE] += 1
                lost[:] = [f"{rejected[UNREADABLE]} of {len(listed)} views cannot be read, the last: {error}"]
                continue
            sound = sound or _check_scale(pair[2], scale, settings)
            if depth_camera is not None and depth is not None:
                depth = depth_camera.registered(depth, camera)
            wheel = None if odometry is None else odometry.at(pair[0])
            travel = None if wheel is None or before is None else planar(inverse(before) @ wheel)
            before = wheel
            capture = Capture(index, pair[0], image=color, depth=depth, sensed=True, travel=travel, extras=extras)
            pose = truth.at(pair[0]) if truth is not None else None
            yield capture, None if pose is None else pose @ inverse(camera.body_from_camera)
            index += 1

    held = {"image", "gray"} | ({"depth"} if deep else set()) | (set() if odometry is None else {"wheel"}) | (
        set() if right is None else {RIGHT_IMAGE, RIGHT_CAMERA})
    return Recording(camera, views(), len(listed), rejected, lost=lost, timed=timed, provides=frozenset(held), right=right)


def _check_scale(path: Path, scale: float, settings) -> bool:
    """Whether the image shows that the scale is right. Raises ConfigError where it shows that it is not."""
    typed = bool(settings.depth_scale)
    depth = read_depth(path, scale=scale, max_depth_m=np.inf, typed=typed)
    return check_depth(depth, scale=scale, where=path.name)


def _read(pair, scale: float, settings, registered: bool) -> tuple[np.ndarray, np.ndarray | None]:
    color = read_color(pair[1])
    if pair[2] is None:
        return color, None
    depth = read_depth(pair[2], scale=scale, max_depth_m=settings.max_depth_m, typed=bool(settings.depth_scale))
    if registered:
        check_pair(color, depth, pair[1].name, "; of depth of a camera of its own type source.depth_camera=[fx,fy,cx,cy]")
    return color, depth


def _pairs(path: Path, settings) -> tuple[list[tuple[float, Path, Path | None]], Counter]:
    """(colour stamp, colour file, depth file) in order of time; lists of each win over associations.txt. No depth file where
    there is no list of them, or none is asked for."""
    color, depth = (next((name for name in names if (path / name).is_file()), None) for names in (COLORS, DEPTHS))
    associated = _associated(path)
    if color is not None and (settings.depth_topic == "none" or depth is None and associated is None):
        if settings.depth_topic != "none" and (path / "depth").is_dir():
            raise ConfigError(f"{path}: {color} is there but depth.txt is not; type source.depth_topic=none to go without")
        if settings.depth_camera:
            raise ConfigError(f"source.depth_camera: {path} holds no list of depth images; leave it out")
        stamps, files, lost = _list(path / color, settings)
        return [(float(stamp), file, None) for stamp, file in zip(stamps, files, strict=True)], +lost
    if color is not None and depth is not None:
        (color_s, colors, lost_a), (depth_s, depths, lost_b) = (_list(path / name, settings) for name in (color, depth))
        pairs = associate(color_s, depth_s, settings.max_difference_s)
        lost = lost_a + lost_b - Counter(jump=lost_b["jump"])  # one clock leaps in both lists
        lost += Counter(unpaired=len(color_s) - len(pairs))
        return [(float(color_s[i]), colors[i], depths[j]) for i, j in pairs], +lost
    if associated is None:
        raise ConfigError(f"{path}: depth.txt is there but rgb.txt is not; replay needs both, or associations.txt")
    return _associations(associated, settings)


def _list(path: Path, settings) -> tuple[np.ndarray, list[Path], Counter]:
    """Stamps and files of rgb.txt or depth.txt; lines out of order or of equal stamps are rejected and counted."""
    stamps, files = [], []
    for number, words in rows(path):
        where = f"{path.name}:{number}"
        if len(words) < 2:
            raise ConfigError(f"{where}: found {len(words)} column(s); expected stamp and file name")
        stamps.append(seconds_of(words[0], where))
        files.append(inside(path.parent, words[1], where))
    if not stamps:
        raise ConfigError(f"{path}: the list is empty; expected lines of stamp and file name")
    kept, rejected = in_order(stamps, settings.max_jump_s)
    return np.array(stamps)[kept], [files[i] for i in kept], rejected


def _truth_file(path: Path, settings) -> Path | None:
    """The user's file of true poses, else groundtruth.txt, else the only *.freiburg (ICL-NUIM), else None."""
    if settings.truth:
        return typed_file(settings.truth)
    found = [path / "groundtruth.txt"] if (path / "groundtruth.txt").is_file() else list(path.glob("*.freiburg"))
    return found[0] if len(found) == 1 else None


def _associations(path: Path, settings) -> tuple[list[tuple[float, Path, Path | None]], Counter]:
    """Lines of stamp, colour, stamp, depth; where the first name says depth and the other does not (ICL-NUIM), the
    other way round."""
    entries = []
    for number, words in rows(path):
        where = f"{path.name}:{number}"
        if len(words) < 4:
            raise ConfigError(f"{where}: found {len(words)} column(s); expected stamp colour stamp depth")
        stamp, color, other, depth = words[:4]
        if "depth" in color.lower() and "depth" not in depth.lower():
            stamp, color, depth = other, depth, color
        entries.append(
            (seconds_of(stamp, where), inside(path.parent, color, where), inside(path.parent, depth, where))
        )
    kept, rejected = in_order([e[0] for e in entries], settings.max_jump_s)
    return [entries[i] for i in kept], rejected


def inside(folder: Path, name: str, where: str) -> Path:
    """The file `name` of `folder`; a name that leads out of the folder is refused. Links are the user's own."""
    name = name.replace("\\", "/")  # of a list that was written on Windows
    path = folder / name  # an absolute name replaces the folder
    inside = path.is_relative_to(folder) or path.resolve().is_relative_to(folder.resolve())
    if not inside or ".." in Path(name).parts:
        raise ConfigError(f"{where}: {name!r} leads out of the recording; expected a file inside {folder}")
    return path
