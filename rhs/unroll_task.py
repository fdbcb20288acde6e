"""The unrolling task: views from inside a tube or corridor to one flat picture of its wall (thesis section 4.3, T11).

Views are those of the source as the sensor reports them, or pictures of a folder (`unroll.path`). Files of the run folder:
config.yaml, mosaic.png (pixels of `unroll.pixel_share`, rows round the tube from the middle of the floor over the right
wall, columns along it), strips.csv (a row per view), overview.png, row.json; truth.png where the true texture is known.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from .bend_finder import BendFinder
from .bending import Winding
from .compose import RunConfig, identity
from .contracts import FeatureSettings
from .errors import ConfigError
from .files import replacing
from .floorplan import World
from .geometry import Camera, inverse
from .mosaic import Mosaic, correlation
from .parts import Parts, build
from .task_row import run_task
from .unroll_folder import Folder
from .unroll_settings import Unroll
from .unrolling import Stitched, Unroller, tube_of
from .vision import gray, write_image


@dataclass(frozen=True, eq=False)
class Seen:
    """One view to unroll, and what is known of the truth for the judge: picture (H, W) gray, depth (H, W) and pose 4x4, or
    None."""

    picture: np.ndarray
    depth: np.ndarray | None = None
    pose: np.ndarray | None = None


def run_unroll_config(config: RunConfig, folder: Path) -> dict[str, Any]:
    """Run the task and return its row, written whatever the outcome; the cause of a failure stands under `_cause`.

    Raises ConfigError before anything ran, for what can be refused."""
    pictures = Folder(config.unroll) if config.unroll.path else None
    row = run_task(identity(config), config, folder,
                   lambda: from_folder(pictures, config.unroll, folder) if pictures else from_source(config, folder))
    if row["_cause"] is None:
        from .unroll_pictures import overview

        overview(folder, config.unroll, row)
    return row


def from_folder(pictures: Folder, settings: Unroll, folder: Path) -> dict[str, Any]:
    """Columns of a run over pictures of which nothing else is known."""
    unroller, strips, cpu_ms = unrolled((Seen(p) for p in pictures), pictures.camera, settings)
    write_image(folder / "mosaic.png", shown(unroller.mosaic.picture()))
    write_strips(folder, strips)
    return columns(unroller, strips, settings) | {"world": Path(settings.path).name, "unroll_ms": cpu_ms}


def from_source(config: RunConfig, folder: Path) -> dict[str, Any]:
    """Columns of a run over the views of the source, judged by its true texture."""
    settings, parts = config.unroll, parts_of(config, folder)
    try:
        judge = judge_of(config, parts)
        unroller, strips, cpu_ms = unrolled(watched(parts, judge), parts.source.camera, settings)
        truth = judge.texture(unroller.mosaic)
    finally:
        parts.source.close()
    picture = unroller.mosaic.picture()
    write_image(folder / "mosaic.png", shown(picture))
    write_strips(folder, strips)
    both = np.isfinite(picture) & np.isfinite(truth)
    if both.any():
        write_image(folder / "truth.png", shown(truth))
    found = {
        "world": parts.source.facts.name,
        "mosaic_correlation": correlation(picture[both], truth[both]) if both.any() else float("nan"),
        "along_error_pct": judge.along_error_percent(strips[-1].along_m),
        "bend_error_deg": judge.heading_error_deg(unroller, strips[-1].along_m),
        "unroll_ms": cpu_ms,
    }
    return columns(unroller, strips, settings) | found


def unrolled(views: Iterator[Seen], camera: Camera, settings: Unroll) -> tuple[Unroller, list[Stitched], float]:
    """All views unrolled in order, after one look at all of them if the bend is to be found; CPU milliseconds per view."""
    tube, first_look_ms = None, 0.0
    if settings.bend == "found":
        views = iter(kept := list(views))
        tube, first_look_ms = found_tube(kept, camera, settings)
    unroller, strips, cost = Unroller(settings, camera, tube), [], []
    for view in views:
        begin = time.process_time()
        strips.append(unroller.add(view.picture))
        cost.append(1e3 * (time.process_time() - begin))
    if len(strips) < 2:
        raise ConfigError(f"{len(strips)} views to unroll; expected at least two")
    return unroller, strips, float(np.median(cost)) + first_look_ms


def found_tube(views: list[Seen], camera: Camera, settings: Unroll) -> tuple[Winding, float]:
    """The tube as the views show it to bend; CPU milliseconds per view (mean)."""
    begin, finder = time.process_time(), BendFinder(settings, camera)
    for view in views:
        finder.look(view.picture)
    return finder.winding, 1e3 * (time.process_time() - begin) / max(len(views), 1)


def columns(unroller: Unroller, strips: list[Stitched], settings: Unroll) -> dict[str, Any]:
    """What can be said without a truth."""
    picture = unroller.mosaic.picture()
    agreement = np.array([strip.agreement for strip in strips[1:]])
    return {
        "strips": len(strips),
        "strips_registered_share": float(np.mean([strip.registered for strip in strips])),
        "strip_agreement": float(np.nanmedian(agreement)),
        "strip_agreement_least": float(np.nanmin(agreement)),
        "along_m": strips[-1].along_m,
        "bend_deg": turned_deg(unroller, settings, strips[-1].along_m),
        "mosaic_length_m": picture.shape[1] * settings.pixel_share * settings.size_m,
        "mosaic_known_share": float(np.isfinite(picture).mean()),
    }


def turned_deg(unroller: Unroller, settings: Unroll, along_m: float) -> float:
    """How far the tube has turned to the left up to there, as it was told or found."""
    forward = unroller.tube.pose(along_m / settings.size_m)[:2, 0]
    return float(np.degrees(np.arctan2(forward[1], forward[0])))


def write_strips(folder: Path, strips: list[Stitched]) -> None:
    """strips.csv: where each view was taken, how well its strip fits."""
    names = [f.name for f in fields(Stitched) if f.name != "values"]
    with replacing(folder / "strips.csv") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*names, "along_sizes", "left_sizes", "up_sizes", "turn_x_rad", "turn_y_rad", "turn_z_rad"])
        for strip in strips:
            table.writerow([*(getattr(strip, name) for name in names), *np.round(strip.values, 6)])


def shown(picture: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 of a gray picture with unknown parts in blue."""
    grey = np.clip(np.rint(np.nan_to_num(picture)), 0, 255).astype(np.uint8)
    out = np.repeat(grey[:, :, None], 3, axis=2)
    out[~np.isfinite(picture)] = (70, 90, 130)
    return out


# --- the source and its truth ------------------------------------------------------------------------------------------


def parts_of(config: RunConfig, folder: Path) -> Parts:
    from .world import load_world

    world: World | None = load_world(config.world) if "driving" in config.source.settings.provides else None
    shared = FeatureSettings(config.features.count, config.features.contrast, config.features.ratio)
    return build(config.chosen(), seed=config.seed, world=world, folder=folder, features=shared)


def watched(parts: Parts, judge: TextureJudge | DepthJudge) -> Iterator[Seen]:
    """The views of the survey as the sensor reports them; the judge looks at the ideal ones."""
    while (capture := parts.source.lead()) is not None:
        judge.look(capture, parts.source.truth())
        observation = parts.sensor.sense(capture)
        if observation.image is None:
            raise ConfigError(f"view {capture.index} has no image; task=unroll needs a source and a sensor with images")
        yield Seen(gray(observation.image))


def judge_of(config: RunConfig, parts: Parts) -> TextureJudge | DepthJudge:
    known = "texture" in config.source.settings.provides
    return (TextureJudge if known else DepthJudge)(config.unroll, parts.source)


class TextureJudge:
    """Knows the texture from the source itself (one that provides `texture`)."""

    def __init__(self, settings: Unroll, source: Any) -> None:
        self._settings, self._source = settings, source
        self._tube, self._unit_m = tube_of(settings), settings.size_m
        if hasattr(source, "tube"):  # who has a texture may know its tube, too: then that is the truth, whatever was told
            self._tube, self._unit_m = source.tube, 1.0
        self._first: np.ndarray | None = None
        self._last = np.eye(4)

    def look(self, capture: Any, truth: np.ndarray | None) -> None:
        """Remember where the views were truly taken."""
        if truth is None:
            return
        eye = truth @ self._source.camera.body_from_camera
        self._first = eye if self._first is None else self._first
        self._last = eye

    def along_error_percent(self, along_m: float) -> float:
        """Of the believed way along the tube at the last view, share of the true one."""
        if self._first is None:
            return float("nan")
        upright = np.eye(4)
        upright[:3, 3] = self._first[:3, 3] - [0.0, self._settings.start_left_m, self._settings.start_up_m]
        point = (inverse(upright) @ self._last)[:3, 3] / self._unit_m
        true_m = float(self._tube.locate(point[None])[0][0]) * self._unit_m
        return 100.0 * abs(along_m - true_m) / true_m if true_m > 0 else float("nan")

    def heading_error_deg(self, unroller: Unroller, along_m: float) -> float:
        """Largest error of the tube's direction up to there; NaN where nobody knows the true one."""
        if not hasattr(self._source, "tube"):
            return float("nan")
        at = np.linspace(0.0, along_m, 200)
        ours = np.array([unroller.tube.pose(s / self._settings.size_m)[:2, 0] for s in at])
        true = np.array([self._source.tube.pose(s)[:2, 0] for s in at])
        cross, dot = true[:, 0] * ours[:, 1] - true[:, 1] * ours[:, 0], (true * ours).sum(axis=1)
        return float(np.degrees(np.abs(np.arctan2(cross, dot)).max()))

    def texture(self, mosaic: Mosaic) -> np.ndarray:
        """(rows, columns) true grey on the mosaic's pixels, NaN where unknown."""
        flat = mosaic.grid(mosaic.first, mosaic.columns) * self._settings.size_m
        return self._source.texture(*flat.T).reshape(mosaic.rows, mosaic.columns).astype(np.float32)


class DepthJudge(TextureJudge):
    """Paints the truth from ideal views, their true depth and true poses: for worlds that nobody unrolled before."""

    REACH = 0.15  # a pixel counts when it lies this near the wall of the section (sizes): not beyond doors and corners

    def __init__(self, settings: Unroll, source: Any) -> None:
        super().__init__(settings, source)
        self._points: list[np.ndarray] = []  # (N, 4) along, around, grey, weight

    def look(self, capture: Any, truth: np.ndarray | None) -> None:
        super().look(capture, truth)
        if truth is None or capture.depth is None or capture.image is None or self._first is None:
            return
        size, camera = self._settings.size_m, self._source.camera
        v, u = (a.ravel() for a in np.indices(capture.depth.shape))
        points = camera.points(np.stack([u, v], axis=1).astype(float), capture.depth.ravel())
        yaw = np.arctan2(self._first[1, 2], self._first[0, 2])  # the camera looks along the tube at first
        c, s = np.cos(yaw), np.sin(yaw)
        world_from_tube = np.eye(4)
        world_from_tube[:2, :2] = [[c, -s], [s, c]]
        world_from_tube[:3, 3] = self._first[:3, 3] - world_from_tube[:3, :3] @ [
            0.0, self._settings.start_left_m, self._settings.start_up_m]
        tube_from_camera = inverse(world_from_tube) @ truth @ camera.body_from_camera
        there = (points @ tube_from_camera[:3, :3].T + tube_from_camera[:3, 3]) / size
        along, left, up = self._tube.locate(np.nan_to_num(there))
        near = np.isfinite(points).all(1) & (np.abs(self._tube.section.slack(left, up)) < self.REACH)
        ahead = np.linalg.norm(points, axis=1) / size
        near &= ahead < 1.5 * self._settings.far_sizes
        rows = np.stack([along, self._tube.section.around(left, up), gray(capture.image).ravel(), ahead**-6.0], axis=1)
        self._points.append(rows[near].astype(np.float32))

    def texture(self, mosaic: Mosaic) -> np.ndarray:
        total, weight = np.zeros((mosaic.rows, mosaic.columns)), np.zeros((mosaic.rows, mosaic.columns))
        row_size = self._tube.section.perimeter_m / mosaic.rows
        for points in self._points:
            column = np.floor(points[:, 0] / mosaic.pixel).astype(int) - mosaic.first
            row = np.floor(points[:, 1] / row_size).astype(int) % mosaic.rows
            inside = (column >= 0) & (column < mosaic.columns)
            at = row[inside], column[inside]
            np.add.at(total, at, points[inside, 2] * points[inside, 3])
            np.add.at(weight, at, points[inside, 3])
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(weight > 0, total / weight, np.nan).astype(np.float32)
