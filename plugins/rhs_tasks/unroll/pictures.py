"""The picture of an unrolling: the mosaic, the truth under it, and how well each strip fits."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from rhs.api.files import write_whole
from rhs.plots import new_figure, save

from .settings import Unrolling


def overview(folder: Path, settings: Unrolling, row: dict[str, Any]) -> Path:
    """overview.png of a run folder of the task."""
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
