"""The unrolling task: views from inside a tube or corridor to one flat picture of its wall (thesis section 4.3, T11).

Views are those of the source as the sensor reports them, or pictures of a folder (`unroll.path`). Files of the run folder:
config.yaml, mosaic.png (pixels of `unroll.pixel_share`, rows round the tube from the middle of the floor over the right
wall, columns along it), strips.csv (a row per view), overview.png, row.json; truth.png where the true texture is known.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.files import replacing, write_whole
from rhs.api.geometry import Camera
from rhs.api.task import Parts, TaskContext, Value
from rhs.estimation.views.features import gray, write_image
from rhs.plots import new_figure, save

from .bend_finder import BendFinder
from .folder import Folder
from .mosaic import correlation
from .settings import Unrolling
from .truth import DepthJudge, TextureJudge
from .unrolling import Stitched, Unroller


class UnrollJob:
    """The views of the source, or the pictures of a folder, unrolled."""

    def __init__(self, settings: Unrolling, context: TaskContext) -> None:
        self.settings, self.folder = settings, context.folder
        self.views: Folder | Parts = Folder(settings) if settings.path else context.parts()
        self.knows_texture = not settings.path and "texture" in context.settings("source").provides

    def run(self) -> Mapping[str, Value]:
        """The columns of the row; mosaic.png, strips.csv and overview.png lie in the folder."""
        row = self.from_folder(self.views) if isinstance(self.views, Folder) else self.from_source(self.views)
        overview(self.folder, self.settings, row)
        return row

    def from_folder(self, pictures: Folder) -> dict[str, Any]:
        """Columns of a run over pictures of which nothing else is known."""
        return self.unrolled(iter(pictures), pictures.camera)[1] | {"world": Path(self.settings.path).name}

    def from_source(self, parts: Parts) -> dict[str, Any]:
        """Columns of a run over the views of the source, judged by its true texture."""
        judge = (TextureJudge if self.knows_texture else DepthJudge)(self.settings, parts.source)
        unroller, row = self.unrolled(watched(parts, judge), parts.source.camera)
        picture, truth = unroller.mosaic.picture(), judge.texture(unroller.mosaic)
        both = np.isfinite(picture) & np.isfinite(truth)
        if both.any():
            write_image(self.folder / "truth.png", shown(truth))
        return row | {
            "world": parts.source.facts.name,
            "mosaic_correlation": correlation(picture[both], truth[both]) if both.any() else float("nan"),
            "along_error_pct": judge.along_error_percent(row["along_m"]),
            "bend_error_deg": judge.heading_error_deg(unroller, row["along_m"]),
        }

    def unrolled(self, views: Iterator[np.ndarray], camera: Camera) -> tuple[Unroller, dict[str, Any]]:
        """All views (H, W) gray unrolled in order, after one look at all of them if the bend is to be found; what can be
        said without a truth, and CPU milliseconds per view. Writes mosaic.png and strips.csv."""
        tube, first_look_ms = None, 0.0
        if self.settings.bend == "found":
            views = iter(kept := list(views))
            begin, finder = time.process_time(), BendFinder(self.settings, camera)
            for view in kept:
                finder.look(view)
            tube, first_look_ms = finder.winding, 1e3 * (time.process_time() - begin) / max(len(kept), 1)
        unroller, strips, cost = Unroller(self.settings, camera, tube), [], []
        for view in views:
            begin = time.process_time()
            strips.append(unroller.add(view))
            cost.append(1e3 * (time.process_time() - begin))
        if len(strips) < 2:
            raise ConfigError(f"{len(strips)} views to unroll; expected at least two")
        write_image(self.folder / "mosaic.png", shown(unroller.mosaic.picture()))
        write_strips(self.folder, strips)
        return unroller, columns(unroller, strips, self.settings) | {"unroll_ms": float(np.median(cost)) + first_look_ms}


def columns(unroller: Unroller, strips: list[Stitched], settings: Unrolling) -> dict[str, Any]:
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


def turned_deg(unroller: Unroller, settings: Unrolling, along_m: float) -> float:
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


def watched(parts: Parts, judge: TextureJudge) -> Iterator[np.ndarray]:
    """The views (H, W) gray of the survey as the sensor reports them; the judge looks at the ideal ones."""
    while (capture := parts.source.lead()) is not None:
        judge.look(capture, parts.source.truth())
        observation = parts.sensor.sense(capture)
        if observation.image is None:
            raise ConfigError(f"view {capture.index} has no image; task=unroll needs a source and a sensor with images")
        yield gray(observation.image)


def overview(folder: Path, settings: Unrolling, row: dict[str, Any]) -> Path:
    """overview.png of a run folder of the task: the mosaic, the truth under it, and how well each strip fits."""
    from matplotlib.image import imread

    pictures = [(name, imread(folder / f"{name}.png")) for name in ("mosaic", "truth") if (folder / f"{name}.png").exists()]
    height, width = pictures[0][1].shape[:2]
    pixel_m = settings.pixel_share * settings.size_m
    panels = len(pictures) + 1
    figure = new_figure(11.0, 1.6 + len(pictures) * max(1.2, min(3.2, 10.0 * height / width)))
    axes = figure.subplots(panels, 1, height_ratios=[3.0] * len(pictures) + [1.6])
    for panel, (name, picture) in zip(axes, pictures, strict=False):
        panel.imshow(picture, extent=(0.0, width * pixel_m, height * pixel_m, 0.0), aspect="auto")
        panel.set_ylabel("round it [m]")
        panel.set_title({"mosaic": "mosaic", "truth": "true texture"}[name], fontsize=9, loc="left")
    axes[len(pictures) - 1].set_xlabel("along the tube [m], from where the first strip begins")
    _fits(axes[-1], folder)
    figure.suptitle(_title(settings, row), fontsize=10)
    return write_whole(folder / "overview.png", lambda path: save(figure, path))


def _fits(axes: Any, folder: Path) -> None:
    with (folder / "strips.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    at = [float(row["along_m"]) for row in rows]
    axes.plot(at, [float(row["agreement"]) for row in rows], color="#1f6fb4", linewidth=1.2)
    lost = [a for a, row in zip(at, rows, strict=True) if row["registered"] != "True"]
    for place in lost:
        axes.axvline(place, color="#c1121f", alpha=0.4, linewidth=1)
    axes.set_ylim(min(0.5, min((float(r["agreement"]) for r in rows[1:]), default=0.5)), 1.01)
    axes.set_ylabel("agreement")
    axes.set_xlabel("where the view was taken [m along the tube]; red: not registered", fontsize=8)


def _title(settings: Unrolling, row: dict[str, Any]) -> str:
    words = [f"{settings.shape} section, {row['strips']} strips, pose {settings.pose}, stitched by {settings.stitch}"]
    if row.get("mosaic_correlation") == row.get("mosaic_correlation") and "mosaic_correlation" in row:
        words.append(f"correlation with the true texture {row['mosaic_correlation']:.3f}")
    words.append(f"{100 * row['strips_registered_share']:.0f} % registered")
    return " · ".join(words)
