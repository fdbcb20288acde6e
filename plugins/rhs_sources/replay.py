"""The replay source: hands out the views of a recording, one per call, read one ahead in a thread of its own."""

from __future__ import annotations

import json
import logging
import math
import re
import shutil
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from rhs.api.contracts import Source
from rhs.api.errors import ConfigError, RecordingError
from rhs.api.files import replacing
from rhs.api.records import Capture, Twist, WorldFacts
from rhs.api.settings import near_file

from .bags.bag import open_bag
from .bags.files import is_bag
from .carmen.log import is_carmen, open_carmen
from .folders.clouds import is_clouds, open_clouds
from .folders.euroc import is_euroc, open_euroc
from .folders.frames import is_frames, open_frames
from .folders.kitti import is_kitti, open_kitti
from .folders.kitti_raw import is_kitti_raw, open_kitti_raw
from .folders.sens import is_sens, open_sens
from .folders.tartan import is_tartan, open_tartan
from .folders.video import SUFFIXES as VIDEOS
from .folders.video import is_video, open_video
from .folders.vkitti import is_vkitti, open_vkitti
from .replay_flat import flattened
from .replay_mcap import is_run, open_run
from .replay_seven_scenes import is_seven_scenes, open_seven_scenes
from .replay_tum import SET_BACK, UNREADABLE, Recording, is_tum, open_tum
from .unread import BESIDE, of_file

log = logging.getLogger("rhs.replay")
NO_VIEWS = re.compile(r"depth|confidence|conf$|mask|label|semantic|instance|segment|normals")  # in names of folders
LENSED = re.compile(r"(?<!un)distorted")
PACKED = (".zip", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".lz4", ".7z", ".rar")
CAMERA_M, LIDAR_M = 10.0, 200.0  # half the side of the square to map, where nobody says


class ReplaySource(Source):
    """A recording as a Source. It can be led, not driven: a run with it is a survey without a patrol.

    Reading and decoding overlap with whatever the caller does between two views; the views do not depend on that.
    """

    def __init__(self, settings, folder: Path | None = None) -> None:
        """folder: of the run; relations to judge it by are copied there, for the metrics alone."""
        recording = open_recording(settings)
        self._relations = _relations(settings)
        self._repaired = recording.repaired
        self._folder = folder
        self.camera = recording.camera
        self.views_expected = recording.total  # None when only reading tells
        self.facts = recording.facts or _facts(settings, recording.provides)
        self.provides = recording.provides  # what this recording holds
        self.rejected = recording.rejected  # what the rules for stamps threw away: reason -> count; grows in a bag
        self._path = settings.path
        self._lost, self.timed = recording.lost, recording.timed
        self._views = recording.views
        self._reader = ThreadPoolExecutor(1, thread_name_prefix="replay")
        self._ahead = self._reader.submit(next, self._views, None)
        if isinstance(error := self._ahead.exception(), ConfigError):  # nothing ran yet
            self._reader.shutdown()
            raise error
        if error is None and self._ahead.result() is None:
            self._reader.shutdown()
            hint = "; type source.max_difference_s=SECONDS for colour and depth that never meet" if self.rejected[
                "unpaired"] else ""
            raise ConfigError(f"source.path={settings.path} holds no whole view "
                              f"({_counted(+self.rejected) or 'nothing rejected'}){hint}")
        self._truth: np.ndarray | None = None
        self._told = self._begun = self._true = False
        self._typed = next((name for name in ("truth", "truth_topic", "truth_frame") if getattr(settings, name)), "")

    @property
    def lost(self) -> str:  # type: ignore[override]  # others set it once; here it grows as views are read
        """What the recording has lost, in words; empty until that is met, and for a whole recording."""
        return "; ".join(self._lost)

    @property
    def stamps_repaired(self) -> int:  # type: ignore[override]  # of a video it grows as views are read
        """Stamps that were put right; no view is lost."""
        return sum(self._repaired.values())

    @property
    def views_lost(self) -> int:  # type: ignore[override]
        """Views that could not be read, or are of a clock that was set back, so far."""
        return self.rejected[UNREADABLE] + self.rejected[SET_BACK]

    def _tell(self) -> None:
        """Once, at the end: what was left out or put right, in the log and in recording.json, for the metrics alone."""
        if self._told:
            return
        self._told = True
        if self._repaired:
            log.warning("replay %s: stamps repaired, the order of the file kept: %s", self._path, _counted(self._repaired))
        if self._begun and self._typed and not self._true:
            log.warning("replay %s: of no view a true pose is known, though source.%s was typed: they are of another clock, "
                        "or further apart than source.max_truth_gap_s; no error is known", self._path, self._typed)
        if self.rejected:
            log.warning("replay %s: rejected or unpaired: %s", self._path, _counted(self.rejected))
        if self._begun and self._folder is not None and self._folder.is_dir():
            with replacing(self._folder / "recording.json") as file:
                json.dump({"rejected": dict(sorted(self.rejected.items()))}, file)

    def lead(self) -> Capture | None:
        """The next recorded view, or None at the end."""
        if not self._begun and self._relations is not None and self._folder is not None:
            shutil.copyfile(self._relations, self._folder / "truth.relations")
        self._begun = True  # what was refused before leaves nothing behind
        view = self._ahead.result()
        if view is None:
            self._truth = None
            self._tell()
            return None
        self._ahead = self._reader.submit(next, self._views, None)
        capture, self._truth = view
        self._true = self._true or self._truth is not None
        return capture

    def begin_patrol(self) -> None:
        """Nothing to put in: a recording cannot be changed."""

    def drive(self, command: Twist) -> Capture:
        raise ConfigError("source=replay cannot be driven; a recording ends with its survey (found a patrol to drive)")

    def teleport(self, world_from_body: np.ndarray) -> None:
        raise ConfigError("source=replay cannot be teleported; type source=simulator")

    def truth(self) -> np.ndarray | None:
        """World_from_body of the last view, interpolated from the recording's ground truth; None when unknown."""
        return self._truth

    def clearance_m(self) -> tuple[float, bool]:
        return math.nan, False

    def close(self) -> None:
        self._reader.shutdown(wait=True, cancel_futures=True)
        self._tell()


def _counted(counts: Counter) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items()))


def _relations(settings) -> Path | None:
    """The file of true relations: the one that was typed, or the one beside a laser log."""
    if settings.relations:
        path = Path(settings.relations).expanduser()
        if not path.is_file():
            raise ConfigError(f"source.relations={settings.relations}: no such file")
        return path
    log_path = Path(settings.path).expanduser()
    beside = log_path.parent / f"{log_path.name.split('.')[0]}.relations"
    return beside if is_carmen(log_path) and beside.is_file() else None


def open_recording(settings) -> Recording:
    """Open `settings.path` by its format. Raises ConfigError saying what was found."""
    if not settings.path:
        raise ConfigError("source.path is empty; type source.path=FOLDER_OR_FILE of the recording")
    path = Path(settings.path).expanduser()
    if not path.exists():
        raise ConfigError(f"source.path={settings.path}: no such file or folder{near_file(path)}")
    if not (path.is_file() or path.is_dir()):
        raise ConfigError(f"source.path={settings.path} is a FIFO or a device; expected a file or a folder")
    try:
        kind = settings.format if settings.format != "auto" else format_of(path)
        _check_used(kind, settings)
        if kind in FORMATS:
            return flattened(FORMATS[kind][1](path, settings), settings.path)
    except RecordingError as error:  # nothing ran yet
        raise ConfigError(str(error)) from error
    if advice := next(filter(None, map(of_file, _likely(path))), ""):
        raise ConfigError(f"source.path={settings.path}: found {advice}")
    found = _found(path)
    expected = "" if "; " in found else ("; expected a TUM, 7-Scenes, KITTI, EuRoC or TartanAir folder, numbered images or "
                                         "clouds, run.mcap, a ROS bag, a video or a CARMEN log")
    raise ConfigError(f"source.path={settings.path}: {found}{expected}")


def _likely(path: Path) -> list[Path]:
    """The file, or those of a folder; tables and arrays, which lie beside anything, only where there is nothing else."""
    inner = sorted(path.iterdir()) if path.is_dir() else [path]
    beside = [p for p in inner if p.suffix.lower() in BESIDE]
    return inner if len(beside) == len(inner) else [p for p in inner if p not in beside]


# Which formats have a use for a setting: what was typed for another is refused, not ignored.
_FOLDERS = ("tum", "seven_scenes", "kitti", "kitti_raw", "tartan", "vkitti", "euroc", "frames", "video", "sens")
USED_BY = {
    "scan_mount": ("bag", "carmen", "clouds"), "camera_mount": (*_FOLDERS, "bag"), "body_frame": ("bag",),
    "rate_hz": ("kitti", "kitti_raw", "tartan", "vkitti", "seven_scenes", "frames", "video", "clouds", "sens"),
    "stereo": ("kitti", "kitti_raw", "tartan", "euroc", "run", "bag", "tum"), "right_topic": ("bag",),
    "depth_camera": ("tum", "seven_scenes", "bag"),
    "camera": (*_FOLDERS, "bag"), "truth": ("tum", "kitti", "kitti_raw", "tartan", "vkitti", "euroc", "frames", "video",
                                            "clouds", "carmen", "bag", "sens"),
    "deskew": ("bag",), "truth_topic": ("bag",), "truth_frame": ("bag",), "truth_of": ("bag",), "views_late_s": ("bag",),
    **dict.fromkeys(("color_topic", "depth_topic", "info_topic", "scan_topic", "wheel_topic"), ("bag",)),
    "laser_fov_deg": ("carmen",), "max_laser_m": ("carmen",),
    "depth_scale": ("tum", "seven_scenes", "frames", "tartan", "vkitti", "sens", "bag"), "phase": ("run",),
}


def _check_used(kind: str, settings) -> None:
    usual = type(settings)()
    for name, kinds in USED_BY.items():
        typed = getattr(settings, name)
        if typed == getattr(usual, name) or kind in kinds or kind not in FORMATS:
            continue
        if typed == "none" and kind != "run":  # they go without it, or hold none
            continue
        if name == "stereo":
            raise ConfigError(f"source.stereo=true (sensor=stereo sets it): of a recording of the kind {kind} no second "
                              "camera is read; type sensor=rgbd if it has depth, sensor=mono for the first one alone, or "
                              "name a KITTI, EuRoC or TartanAir folder or a bag")
        raise ConfigError(f"source.{name}: a recording of the kind {kind} has no use for it; leave it out")


def _facts(settings, provides: frozenset[str]) -> WorldFacts:
    """A recording made elsewhere: it begins at the origin of its map, and nobody named its places."""
    half = settings.extent_m or (LIDAR_M if "cloud" in provides else CAMERA_M)
    return WorldFacts(Path(settings.path).name, (0.0, 0.0, 0.0), (), (-half, -half, half, half), 0.2,
                      bounds_known=settings.extent_m > 0.0)


def format_of(path: Path) -> str:
    return next((name for name, (fits, _) in FORMATS.items() if fits(path)), "unknown")


# Asked in this order when nobody says: a run of rhs before any other MCAP file.
FORMATS = {
    "tum": (is_tum, open_tum),
    "seven_scenes": (is_seven_scenes, open_seven_scenes),
    "kitti": (is_kitti, open_kitti),
    "kitti_raw": (is_kitti_raw, open_kitti_raw),
    "tartan": (is_tartan, open_tartan),
    "vkitti": (is_vkitti, open_vkitti),
    "euroc": (is_euroc, open_euroc),
    "run": (is_run, open_run),
    "carmen": (is_carmen, open_carmen),
    "bag": (is_bag, open_bag),
    "video": (is_video, open_video),
    "frames": (is_frames, open_frames),
    "sens": (is_sens, open_sens),
    "clouds": (is_clouds, open_clouds),
}


def _found(path: Path) -> str:
    if path.is_file():
        if path.name == "metadata.yaml":
            return f"found a file of a bag; type source.path={path.parent}"
        if path.suffix.lower() in (".zst", ".zstd"):
            of_bag = (path.parent / "metadata.yaml").is_file()
            return f"found a packed file; type {f'source.path={path.parent}' if of_bag else f'zstd -d {path.name}'}"
        packed = path.name.lower().endswith(PACKED)
        return "found an archive; unpack it first" if packed else f"found a file of {path.stat().st_size} bytes"
    if (path / "image_2").is_dir() or (path / "image_0").is_dir():
        return "found a KITTI sequence without its calib.txt"
    if list(path.glob("[!.]*.db3")):
        return f"found a bag without its metadata.yaml; type: ros2 bag reindex {path}"
    bags = sorted([*path.glob("[!.]*.bag"), *path.glob("[!.]*.mcap")])
    if len(bags) > 1:
        return f"found {len(bags)} bags; type source.path={bags[0]} (the parts of one are read together if numbered alike)"
    names = sorted(p.name for p in path.iterdir())
    seen = [p for p in sorted(path.iterdir()) if not p.name.startswith(".")]
    video = next((p for p in seen if p.suffix.lower() in VIDEOS), None)
    if video is not None and (path / "depth").is_dir():
        return (f"found {video.name} beside depth; in that folder type: mkdir rgb; ffmpeg -i {video.name} -vsync 0 "
                "-start_number 0 rgb/%06d.png")
    if video is not None:
        return f"found a video; type source.path={video}"
    inner = [p for p in (*sorted(path.iterdir()), *sorted(path.glob("*/*"))) if p.is_dir() and format_of(p) != "unknown"
             and not NO_VIEWS.search(str(p.relative_to(path)).lower())]
    if inner:
        best = min(inner, key=lambda p: (LENSED.search(str(p.relative_to(path))) is not None, is_clouds(p)))
        return f"found no recording but one in it; type source.path={best}"
    if logs := [p for p in seen if is_carmen(p)]:
        return f"found {len(logs)} laser log{'s' if len(logs) > 1 else ''}; type source.path={logs[0]}"
    return f"found {', '.join(names[:5])}{' ...' if len(names) > 5 else ''}" if names else "found an empty folder"
