"""Pictures of plans, from the files of run folders: one problem, a panel of maps by planners, bars with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.files import write_whole
from rhs.plots import new_figure, save
from rhs.runfolder.row import read_row
from rhs.worlds.maps import load_map
from rhs.worlds.plan_files import read_plan

from .drawing import extent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TREE, RAW, SHORT, START, GOAL = "#9bbfd9", "#e0912f", "#b03a9c", "#2a9d5c", "#c1121f"


def plan_picture(folder: FilePath) -> FilePath:
    """plan.png: the map, the tree, roadmap or walk, the raw and the shortened path, start and goal."""
    figure = new_figure(9.2, 6.6)
    axes = figure.add_subplot()
    draw_plan(axes, folder)
    row = read_row(folder / "row.json")
    axes.set_title(_title(row), fontsize=10)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return _write(figure, folder / "plan.png")


def draw_plan(axes: Axes, folder: FilePath, *, thin: float = 1.0) -> None:
    """One problem into axes; `thin` scales the widths of lines."""
    from matplotlib.collections import LineCollection

    grid = load_map(folder / "map.yaml")
    path, problem, _ = read_plan(folder)
    axes.imshow(np.where(problem.blocked, 0.25, 1.0), cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent(grid),
                interpolation="nearest", zorder=0)
    if (folder / "sketch.npy").is_file():
        lines = np.load(folder / "sketch.npy", allow_pickle=False)
        if np.median(np.hypot(*(lines[:, 1] - lines[:, 0]).T)) > 0.02 * (extent(grid)[1] - extent(grid)[0]):  # no dots
            lines = lines[:: max(1, round(len(lines) / (4000 * thin**2)))]
        axes.add_collection(LineCollection(list(lines), colors=TREE, linewidths=0.5 * thin, zorder=1))
        axes.plot([], [], color=TREE, linewidth=1.0, label="tree, roadmap or field")
    if path.found:
        axes.plot(*path.raw_m.T, color=RAW, linewidth=1.3 * thin, label="raw", zorder=2)
        axes.plot(*path.points_m.T, color=SHORT, linewidth=1.8 * thin, label="shortened", zorder=3)
    size = 7.0 * thin
    axes.plot(*problem.start_m, "o", color=START, markersize=size, label="start", zorder=4)
    axes.plot(*problem.goal_m, "*", color=GOAL, markersize=1.4 * size, label="goal", zorder=4)
    left, right, bottom, top = extent(grid)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")


def panel(runs: dict[tuple[str, str], FilePath], maps: Sequence[str], planners: Sequence[str], target: FilePath) -> FilePath:
    """Maps from top to bottom, planners from left to right; runs: (map, planner) -> run folder. A gap where none is."""
    figure = new_figure(1.9 * len(planners) + 0.4, 2.05 * len(maps) + 0.7)
    axes = figure.subplots(len(maps), len(planners), squeeze=False)
    for i, world in enumerate(maps):
        for j, name in enumerate(planners):
            one = axes[i, j]
            one.set_xticks([])
            one.set_yticks([])
            if (world, name) in runs:
                draw_plan(one, runs[world, name], thin=0.55)
                one.set_xlabel(_caption(read_row(runs[world, name] / "row.json")), fontsize=6)
            else:
                one.axis("off")
            if i == 0:
                one.set_title(name, fontsize=8)
            if j == 0:
                one.set_ylabel(world, fontsize=8)
    drawn = {label: line for one in axes.flat for line, label in zip(*one.get_legend_handles_labels(), strict=True)}
    figure.legend(drawn.values(), drawn.keys(), loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    return _write(figure, target)


def bars(groups: Sequence[tuple[str, str, float, float, float]], label: str, target: FilePath, *, title: str = "",
         log: bool = False) -> FilePath:
    """Bars of one column: groups holds (map, planner, mean, low, high), NaN where nothing was found; no line where there
    is no interval."""
    maps, planners = list(dict.fromkeys(g[0] for g in groups)), list(dict.fromkeys(g[1] for g in groups))
    figure = new_figure(max(6.0, 0.35 * len(planners) * len(maps) * 0.5 + 2.0), 3.6)
    axes = figure.add_subplot()
    wide = 0.8 / len(planners)
    colours = [f"C{k % 10}" for k in range(len(planners))]
    for k, planner in enumerate(planners):
        mine = {g[0]: g[2:] for g in groups if g[1] == planner}
        mean, low, high = np.array([mine.get(world, (np.nan,) * 3) for world in maps]).T
        at = np.arange(len(maps)) + (k - (len(planners) - 1) / 2) * wide
        hatch = "//" if k >= 10 else None
        axes.bar(at, mean, 0.9 * wide, color=colours[k], hatch=hatch, label=planner, zorder=2)
        known = np.isfinite(low)
        spread = np.clip(np.stack([mean - low, high - mean])[:, known], 0.0, None)
        axes.errorbar(at[known], mean[known], yerr=spread, fmt="none", ecolor="black", elinewidth=0.8, capsize=1.5, zorder=3)
    axes.set_xticks(np.arange(len(maps)), maps)
    axes.set_ylabel(label)
    axes.grid(axis="y", color="#dddddd", zorder=0)
    axes.set_title(title, fontsize=8)
    if log and any(group[2] > 0.0 for group in groups):
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=7, frameon=False)
    return _write(figure, target)


def _title(row: dict[str, Any]) -> str:
    head = f"{FilePath(str(row.get('world'))).name} · {row.get('planner')} · seed {row.get('seed')}"
    return f"{head}\n{_caption(row)}"


def _caption(row: dict[str, Any]) -> str:
    if not row.get("plan_success"):
        return str(row.get("plan_reason") or row.get("reason") or row.get("status"))
    above, time_ms = row.get("plan_above_optimum_pct"), row.get("plan_ms")
    text = f"{row['plan_length_m']:.2f} m"
    text += f", +{above:.1f} %" if isinstance(above, float) else ""
    return text + (f", {time_ms:.1f} ms" if isinstance(time_ms, float) else "")


def _write(figure: Figure, target: FilePath) -> FilePath:
    return write_whole(target, lambda path: save(figure, path))
