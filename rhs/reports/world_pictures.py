"""Plans of worlds: one thumbnail each, and a sheet with many side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rhs.api.floorplan import World
from rhs.plots.figure import new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOW_M = 0.8  # furniture up to here is drawn lighter
SHEET_COLUMNS = 5


def draw_plan(axes: Axes, world: World, title: str) -> None:
    """Walls black, furniture brown (light: low; outlined: hanging over nothing), obstacles after the survey red, paths of
    people light blue, the survey blue from its green start, places as crosses."""
    for box in world.boxes:
        high = box.bottom_m + box.size_m[2]
        colour = "#e3cfae" if high <= LOW_M else "#b08a58"
        axes.fill(*box.corners_m.T, facecolor="none" if box.bottom_m > 0 else colour, edgecolor="#7d5f36", linewidth=0.5)
    for box in world.obstacles:
        axes.fill(*box.corners_m.T, facecolor="#d62728", edgecolor="none")
    for person in world.moving.people:
        axes.plot(*np.vstack([person.path_m, person.path_m[:1]]).T, color="#8ecae6", linewidth=2.0, alpha=0.8)
    for wall in world.walls:
        axes.plot(*wall.points_m.T, color="black", linewidth=1.2)
    axes.plot(*world.route_m.T, color="#1f77b4", linewidth=0.7)
    axes.plot(*world.start[:2], "o", color="#2ca02c", markersize=4)
    if world.places:
        axes.plot(*np.array([place[1:] for place in world.places]).T, "x", color="#9467bd", markersize=5)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(title, fontsize=7)


def write_pictures(worlds: Sequence[tuple[str, World]], folder: Path) -> list[Path]:
    """`NAME.png` of each world, and `worlds.png` with all of them; characters that no file name has become `_`."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, world in worlds:
        figure = new_figure(3.2, 3.2)
        draw_plan(figure.add_subplot(), world, name)
        written.append(folder / f"{''.join(c if c.isalnum() or c in '._-' else '_' for c in name)}.png")
        save(figure, written[-1])
    columns = max(1, min(SHEET_COLUMNS, len(worlds)))
    rows = -(-len(worlds) // columns)
    figure = new_figure(2.6 * columns, 2.6 * rows)
    for number, (name, world) in enumerate(worlds, 1):
        draw_plan(figure.add_subplot(rows, columns, number), world, name)
    written.append(folder / "worlds.png")
    save(figure, written[-1])
    return written
