"""A run while it happens, in the Rerun viewer. The only home of the rerun package, which is optional."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rhs.api.geometry import Camera
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Step
from rhs.base.errors import ConfigError, RhsError

WORDS = "viewer (opens one), an address such as rerun+http://127.0.0.1:9876/proxy, or a file ending in .rrd"


class Listener(Protocol):
    """What a run tells its recorder and its viewer."""

    def step(self, step: Step) -> None: ...

    def map(self, grid: OccupancyGrid, stamp_s: float) -> None: ...

    def close(self, status: str = "ok", reason: str = "") -> None: ...


class Audience:
    """Several listeners as one."""

    def __init__(self, listeners: Sequence[Listener]):
        self._listeners = list(listeners)

    def step(self, step: Step) -> None:
        for listener in self._listeners:
            listener.step(step)

    def map(self, grid: OccupancyGrid, stamp_s: float) -> None:
        for listener in self._listeners:
            listener.map(grid, stamp_s)

    def close(self, status: str = "ok", reason: str = "") -> None:
        for listener in self._listeners:
            listener.close(status, reason)


def check_live(where: str) -> None:
    """Refuse, before anything runs, a target that cannot be, and a viewer that is not installed."""
    if not where:
        return
    if where != "viewer" and not where.endswith(".rrd") and not re.match(r"(rerun\+)?https?://", where):
        raise ConfigError(f"live={where} is not {WORDS}")
    if importlib.util.find_spec("rerun") is None:
        raise ConfigError(f"live={where} needs the Rerun viewer; type: pip install 'rhs[live]'")


class LiveView:
    """Streams steps to Rerun: robot and camera, images, scan, ways gone, plans, map, error and times."""

    def __init__(self, where: str, camera: Camera, name: str = "rhs"):
        import rerun

        self._rr: Any = rerun
        self._stream = rerun.RecordingStream(f"rhs_{name}")
        self._camera = camera
        self._ways: dict[str, list[np.ndarray]] = {}
        self._plan: object = None
        try:
            if where == "viewer":
                self._stream.spawn()
            elif where.endswith(".rrd"):
                self._stream.save(Path(where))
            else:
                self._stream.connect_grpc(where)
        except Exception as error:  # rerun has no error type of its own
            raise RhsError(f"live={where}: cannot reach the viewer: {str(error).splitlines()[0]}") from error
        self._log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._log("world/robot/camera", rerun.Transform3D(translation=camera.body_from_camera[:3, 3],
                                                          mat3x3=camera.body_from_camera[:3, :3]), static=True)
        self._log("world/robot/camera", rerun.Pinhole(image_from_camera=camera.matrix, width=camera.width,
                                                      height=camera.height), static=True)

    def step(self, step: Step) -> None:
        """Show one step."""
        rr, pose, seen = self._rr, step.belief.map_from_body, step.observation
        self._stream.set_time("robot", duration=step.stamp_s)
        self._log("world/robot", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        if seen.image is not None:
            self._log("world/robot/camera/image", rr.Image(seen.image).compress(jpeg_quality=85))
        if seen.depth is not None:
            self._log("world/robot/camera/depth", rr.DepthImage(seen.depth, meter=1.0))
        if step.scan is not None:
            self._log("world/robot/scan", rr.Points3D(_hits(step), radii=0.03, colors=[60, 60, 60]))
        self._way(f"world/{step.phase}_believed", pose, [209, 128, 31])
        if step.truth is not None:
            self._way(f"world/{step.phase}_true", step.truth, [34, 34, 34])
            error_m = float(np.linalg.norm((pose - step.truth)[:2, 3]))
            self._log("numbers/error_m", rr.Scalars(error_m))
        if step.path is not None and step.path is not self._plan:
            self._plan = step.path
            self._log("world/plan", rr.LineStrips3D([_raised(step.path.points_m, 0.02)], colors=[176, 58, 156]))
        for stage, milliseconds in step.timings_ms.items():
            self._log(f"numbers/{stage}_ms", rr.Scalars(milliseconds))
        if step.event:
            self._log("events", rr.TextLog(step.event))

    def map(self, grid: OccupancyGrid, stamp_s: float) -> None:
        """Show the occupied cells of the map."""
        self._stream.set_time("robot", duration=stamp_s)
        walls = grid.centres(np.argwhere(grid.occupied()))
        self._log("world/map", self._rr.Points3D(_raised(walls, 0.0), radii=grid.resolution_m / 2, colors=[20, 20, 20]))

    def close(self, status: str = "ok", reason: str = "") -> None:
        """Say how the run ended and let the viewer go."""
        self._log("events", self._rr.TextLog(f"{status} {reason}".strip()))
        self._stream.flush()
        self._stream.disconnect()

    def _way(self, name: str, pose: np.ndarray, colour: list[int]) -> None:
        way = self._ways.setdefault(name, [])
        way.append(pose[:3, 3].copy())
        self._log(name, self._rr.LineStrips3D([np.array(way)], colors=colour))

    def _log(self, name: str, what: Any, *, static: bool = False) -> None:
        self._stream.log(name, what, static=static)


def _hits(step: Step) -> np.ndarray:
    """(N, 3) ends of the beams in the body frame, at the camera's height."""
    scan = step.scan
    assert scan is not None
    seen = np.isfinite(scan.ranges_m)
    bearing, reach = scan.bearings_rad[seen], scan.ranges_m[seen]
    ends = scan.origin_xy_m + reach[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    return _raised(ends, step.observation.camera.height_m)


def _raised(points_m: np.ndarray, height_m: float) -> np.ndarray:
    return np.column_stack([np.reshape(points_m, (-1, 2)), np.full(len(points_m), height_m)])
