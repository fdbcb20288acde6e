"""Saved tracks run again through any monocular filter, and what comes of it against the truth."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api import settings
from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, planar, se2, wrap
from rhs.api.records import Revision, Tracking, Wall
from rhs.api.trajectory import read_tum
from rhs.estimation.filters.kalman import nees
from rhs.plots import draw_errors, new_figure, save

from ..corridor.config import CorridorEkf
from ..corridor.ekf import corridor_core
from ..section.config import SectionEkf, TubeEkf
from ..section.ekf import section_core
from .monocular import MonocularOdometry
from .track_frames import Tracks, load_tracks

Core = Callable[[Any, Camera, np.ndarray], Any]
FILTERS: dict[str, tuple[type, Core]] = {
    "corridor_ekf": (CorridorEkf, corridor_core),
    "section_ekf": (SectionEkf, section_core),
    "tube_ekf": (TubeEkf, section_core),
}
AFTER_CORNER_M = 2.0  # the heading is looked at this far behind a corner


@dataclass(frozen=True, eq=False)
class FilterRun:
    """One filter over one run. errors, sigmas (N, 3): x m, y m, yaw rad in the map, sigma NaN where the filter has none
    of its pose; poses, truth (N, 3); nees (N,); trusted (N,) bool; walls; cpu_ms per view (N,); revision: what the filter
    says of the whole survey at its end, None if nothing."""

    poses: np.ndarray
    truth: np.ndarray
    errors: np.ndarray
    sigmas: np.ndarray
    nees: np.ndarray
    trusted: np.ndarray
    walls: tuple[Wall, ...]
    cpu_ms: np.ndarray
    revision: Revision | None = None


def make_filter(name: str, values: dict[str, Any], tracks: Tracks) -> Any:
    """The filter of that name for these tracks. Raises ConfigError for an unknown name or setting."""
    if name not in FILTERS:
        raise ConfigError(f"odometry {name} does not run on tracks; choose one of {', '.join(FILTERS)}")
    cls, core = FILTERS[name]
    return core(settings.make(cls, values, f"odometry.{name}"), tracks.camera, tracks.start)


def run_filter(name: str, values: dict[str, Any], tracks: Tracks) -> FilterRun:
    """Run the filter over all views and compare with the truth, without any alignment."""
    core = make_filter(name, values, tracks)
    eye, pose = MonocularOdometry(None, core, se2(*tracks.start)), se2(*tracks.start)
    rows, sigmas, honesty, trusted, cost = [], [], [], [], []
    for frame, truth in zip(tracks.frames, tracks.truth, strict=True):
        begin = time.process_time()
        motion = eye.update_tracks(frame)
        cost.append(1e3 * (time.process_time() - begin))
        pose = pose @ motion.previous_from_body
        error = planar(pose) - planar(truth)
        error[2] = wrap(error[2])
        spread = core.pose_covariance()
        rows.append((planar(pose), planar(truth), error))
        sigmas.append(np.sqrt(np.diag(spread)))
        honesty.append(nees(error, spread))
        trusted.append(motion.status is Tracking.OK)
    poses, truths, errors = (np.array(column) for column in zip(*rows, strict=True))
    return FilterRun(poses, truths, errors, np.array(sigmas), np.array(honesty), np.array(trusted), core.walls(),
                  np.array(cost), core.revise())


def figures(run: FilterRun) -> dict[str, float]:
    """Numbers of one replay; lengths in metres of the unaligned trajectory."""
    gap = np.hypot(run.errors[:, 0], run.errors[:, 1])
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(run.truth[:, :2], axis=0).T))])
    after = heading_after_corners(run, way)
    return {
        "way_m": way[-1],
        "ate_m": float(np.sqrt((gap**2).mean())),
        "half_way_error_m": float(gap[np.searchsorted(way, 0.5 * way[-1])]),
        "end_error_m": float(gap[-1]),
        "end_error_percent": 100.0 * float(gap[-1]) / max(way[-1], 1e-9),
        "largest_error_m": float(gap.max()),
        "largest_yaw_error_deg": float(np.degrees(np.abs(run.errors[:, 2])).max()),
        "yaw_after_corner_deg": float(np.max(after)) if len(after) else float("nan"),
        "corners": float(len(after)),
        "nees_median": float(np.median(run.nees[1:])),
        "doubted_share": float(1.0 - run.trusted.mean()),
        "walls": float(len(run.walls)),
        "cpu_ms_median": float(np.median(run.cpu_ms)),
        "cpu_ms_p95": float(np.percentile(run.cpu_ms, 95)),
    }


def heading_after_corners(run: FilterRun, way: np.ndarray) -> np.ndarray:
    """(C,) absolute heading errors, degrees, two metres behind each corner of more than 45 degrees."""
    yaw = np.unwrap(run.truth[:, 2])
    turned = np.abs(np.interp(way + 0.75, way, yaw) - np.interp(way - 0.75, way, yaw)) > np.radians(45.0)
    ends = np.flatnonzero(turned[:-1] & ~turned[1:]) + 1
    at = [int(np.searchsorted(way, way[k] - 0.75 + AFTER_CORNER_M)) for k in ends]
    return np.array([abs(np.degrees(run.errors[k, 2])) for k in at if k < len(way)])


def open_tracks(path: Path) -> Tracks:
    """Tracks from a file, or from a run folder with tracks.npz, whose truth_survey.tum is then the truth."""
    if not path.is_dir():
        return load_tracks(path)
    tracks, truth = load_tracks(path / "tracks.npz"), path / "truth_survey.tum"
    if not truth.exists():
        return tracks
    known = read_tum(truth).poses
    return Tracks(tracks.camera, tracks.start, tracks.frames[: len(known)], known[: len(tracks.frames)])


def draw(run: FilterRun, title: str, path: Path) -> None:
    """Write a PNG: position and angle against the step with the three-sigma band, and the top view with walls."""
    figure = new_figure(13.0, 7.0)
    axes = figure.subplot_mosaic([["x", "top"], ["y", "top"], ["yaw", "top"]], width_ratios=[1.0, 1.1])
    scales = (("x", 0, 1.0, "error in x [m]"), ("y", 1, 1.0, "error in y [m]"), ("yaw", 2, 180 / np.pi, "error in yaw [°]"))
    for name, k, scale, label in scales:
        draw_errors(axes[name], scale * run.errors[:, k], scale * run.sigmas[:, k], run.trusted)
        axes[name].set_ylabel(label)
    axes["yaw"].set_xlabel("view")
    axes["x"].legend(loc="upper left", fontsize=8)
    _top(axes["top"], run)
    figure.suptitle(title)
    save(figure, path)


def _top(axes, run: FilterRun) -> None:
    for wall in run.walls:
        ends = np.stack([wall.start_xy_m, wall.end_xy_m])
        axes.plot(ends[:, 0], ends[:, 1], color="black", linewidth=2.0)
    axes.plot([], [], color="black", linewidth=2.0, label="walls found")
    axes.plot(run.truth[:, 0], run.truth[:, 1], color="#2c7fb8", linewidth=2.5, label="true path")
    axes.plot(run.poses[:, 0], run.poses[:, 1], color="#c0392b", linewidth=1.2, label="believed path")
    axes.plot(*run.truth[0, :2], "o", color="#2c7fb8")
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="best", fontsize=8)
