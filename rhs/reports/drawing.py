"""The layers of a picture of a run: map, walls, trajectories, plans, places; from the files of its folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.api.trajectory import Trajectory, aligned
from rhs.metrics.accuracy import pair
from rhs.metrics.patrol import arrived_elsewhere, gets_to, patrol_steps
from rhs.metrics.success import places_within_reach
from rhs.runfolder.run import Run

from .event_marks import draw_happenings, draw_moving, draw_unknown

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"truth": "#222222", "estimate": "#d1801f", "corrected": "#1f6fb4", "patrol": "#2a9d5c", "plan": "#b03a9c",
           "place": "#c1121f", "wall": "#f2b600"}
UNSEEN = (219, 224, 235, 255)  # grey-blue
LEAP_M, LEAP_STEPS = 1.0, 8.0  # a line is not drawn across a step longer than this, and than so many usual ones
PAIRED_S = 0.02  # a belief and a truth at most so far apart in time are of one moment
MARGIN_M = 0.3  # round what is drawn


def title(row: dict[str, Any]) -> str:
    """Two lines: what ran, and the key numbers."""
    parts = [row.get(name) for name in ("world", "sensor", "odometry", "loop_closer", "planner", "localiser")]
    first = " · ".join(str(part) for part in parts if part) + (f" · seed {row['seed']}" if "seed" in row else "")
    numbers = [_number(row, "ate_rmse_m", "ATE {:.3f} m"), _number(row, "end_error_m", "end error {:.3f} m"),
               _number(row, "found_share", "found after {:.0%} of the starts"),
               _number(row, "belief_wrong_sure_share", "wrong and sure {:.1%}"),
               _number(row, "map_agreement", "map agreement {:.1%}"),
               _number(row, "collisions", "1 collision" if row.get("collisions") == 1 else "{:.0f} collisions")]
    if row.get("places_total") and row.get("patrol_steps") != 0:  # rows of old said so of a survey too
        barred = float(row["places_total"]) - places_within_reach(row)
        numbers.insert(0, f"{row.get('places_visited')}/{row['places_total']} places"
                       + (f", {barred:.0f} out of reach" if barred > 0 else ""))
    if row.get("status") not in (None, "ok"):
        numbers.insert(0, f"{row['status']}: {str(row.get('reason', ''))[:80]}")
    return first + "\n" + " · ".join(n for n in numbers if n)


def draw_run(axes: Axes, run: Run) -> None:
    """The layers of a run that exist, bottom to top."""
    grid, true = run.grid("map"), run.grid("true_map")
    if grid is not None:
        draw_grid(axes, grid)
    if true is not None:
        draw_walls(axes, true)
        after = run.grid("true_map_patrol")
        if after is not None:
            draw_unknown(axes, true, after)
    draw_found_walls(axes, run)
    draw_moving(axes, run.json("moving") or {})
    draw_lines(axes, run)
    draw_plans(axes, run)
    draw_places(axes, run)
    draw_happenings(axes, run.steps, run.json("missions") or [])
    if grid is not None:
        show_what_is_known(axes, grid)
    axes.set_aspect("equal")
    unit = unit_of(run.json("row") or {})
    axes.set_xlabel(f"x [{unit}]")
    axes.set_ylabel(f"y [{unit}]")


def unit_of(row: dict[str, Any]) -> str:
    """Of lengths in a run's map: a single camera that nobody told the scale has one of its own."""
    return "unknown unit" if row.get("scale_known") == 0.0 else "m"


def draw_grid(axes: Axes, grid: OccupancyGrid) -> None:
    """Occupancy as grey: white free, black occupied, grey-blue never seen."""
    unknown = np.isnan(grid.probability)
    image = np.empty((*grid.shape, 4), np.uint8)  # with numbers Matplotlib would hold eight times as much
    image[:] = np.where(unknown, 0.0, np.rint(255.0 * (1.0 - grid.probability)))[:, :, None]
    image[unknown] = UNSEEN
    image[:, :, 3] = 255
    axes.imshow(image, origin="lower", extent=extent(grid), interpolation="nearest", zorder=0)
    axes.fill([], [], facecolor="black", label="mapped as occupied")
    axes.fill([], [], facecolor=[channel / 255.0 for channel in UNSEEN], label="never seen")


def draw_walls(axes: Axes, true: OccupancyGrid) -> None:
    """Outline of the true walls."""
    walls = true.occupied().astype(float)
    if walls.any() and min(walls.shape) > 1:
        rows, columns = np.arange(walls.shape[0]), np.arange(walls.shape[1])
        x = true.origin_m[0] + (columns + 0.5) * true.resolution_m
        y = true.origin_m[1] + (rows + 0.5) * true.resolution_m
        axes.contour(x, y, walls, levels=[0.5], colors="#7ab8e0", linewidths=0.8, zorder=1)
        axes.plot([], [], color="#7ab8e0", linewidth=0.8, label="true walls")


def draw_found_walls(axes: Axes, run: Run) -> None:
    """The walls that an odometry without depth found on the survey, of which the map was drawn."""
    label = "walls found"
    for wall in run.json("walls") or []:
        ends = np.array([wall["start_m"], wall["end_m"]])
        axes.plot(ends[:, 0], ends[:, 1], color=COLOURS["wall"], linewidth=2.2, marker="|", markersize=9,
                  label=label, zorder=2)
        label = "_nolegend_"


def draw_lines(axes: Axes, run: Run) -> None:
    """Trajectories: truth thin and dark, beliefs in colour. A truth measured in a frame of its own (a motion-capture
    room) is laid onto the corrected way as the row's ATE was; that of a simulator stands in the frame of the map."""
    simulated = run.grid("true_map") is not None
    how = "none" if simulated else str((run.json("row") or {}).get("ate_alignment") or "none")
    note = "" if how == "none" else f" ({how} aligned)"
    loops = sum(bool(edge.get("accepted")) for edge in (run.json("closure") or {}).get("edges", ()))
    closed = f"survey, {loops} loop{'s' * (loops > 1)} closed" if loops else "survey, corrected without a loop"
    settled = "corrected" if (run.folder / "corrected.tum").exists() else "estimate"
    styles = (("truth_survey", settled, f"survey, true{note}", COLOURS["truth"], 1.4, "-"),
              ("estimate", "", "survey, as believed", COLOURS["estimate"], 1.2, "-"),
              ("corrected", "", closed, COLOURS["corrected"], 1.2, "-"),
              ("truth_patrol", "patrol", f"patrol, true{note}", COLOURS["truth"], 1.4, ":"),
              ("patrol", "", "patrol, as believed", COLOURS["patrol"], 1.2, "-"),
              ("truth_localised", "", "true way, in the map", COLOURS["truth"], 1.4, ":"),
              ("localised", "", "as believed", COLOURS["patrol"], 1.2, "-"))
    for name, onto, label, colour, width, style in styles:
        if (line := run.trajectory(name)) is not None:
            if onto and how != "none" and (belief := run.trajectory(onto)) is not None:
                line = laid_onto(line, belief, how)
            xy = broken_at_leaps(line.positions_m[:, :2])
            axes.plot(xy[:, 0], xy[:, 1], color=colour, linewidth=width, linestyle=style, label=label, zorder=3)


def broken_at_leaps(xy_m: np.ndarray) -> np.ndarray:
    """(M, 2) of a line (N, 2) with NaN where it leaps: a robot carried off, or of another mind, drove no such way."""
    step_m = np.linalg.norm(np.diff(xy_m, axis=0), axis=1)
    moving_m = step_m[step_m > 0]
    if not len(moving_m):
        return xy_m
    leaps = np.nonzero(step_m > max(LEAP_M, LEAP_STEPS * float(np.median(moving_m))))[0]
    return np.insert(xy_m.astype(float), leaps + 1, np.nan, axis=0)


def laid_onto(way: Trajectory, other: Trajectory, how: str) -> Trajectory:
    """The poses of a way that have one in the other, a belief's or the true one's, moved onto it as for the ATE."""
    both = pair(way, other, PAIRED_S)
    return aligned(both.estimate, both.truth, how)


def show_what_is_known(axes: Axes, grid: OccupancyGrid) -> None:
    """Cut the axes down to the known cells and what is drawn over them; a large empty map leaves nothing to see."""
    rows, columns = np.nonzero(~np.isnan(grid.probability))
    cells = np.stack([columns, rows], axis=1)
    corners = np.concatenate([cells, cells + 1]) * grid.resolution_m + np.asarray(grid.origin_m)
    drawn = [np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float) for line in axes.get_lines()]
    points = np.concatenate([corners, *(line for line in drawn if len(line))])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points):
        (x0, y0), (x1, y1) = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
        axes.set_xlim(x0, x1)
        axes.set_ylim(y0, y1)


def draw_plans(axes: Axes, run: Run) -> None:
    """Every path that was planned."""
    label = "planned"
    for plan in run.json("plans") or []:
        points = np.asarray(plan.get("points_m") or [], float).reshape(-1, 2)
        if len(points) > 1:
            axes.plot(points[:, 0], points[:, 1], color=COLOURS["plan"], linewidth=0.9, linestyle="--", label=label,
                      zorder=2)
            label = "_nolegend_"


def draw_places(axes: Axes, run: Run) -> None:
    """Places by name, each with what became of it."""
    facts, missions = run.json("facts") or {}, run.json("missions") or []
    arrived = {m["place"] for m in missions if m["status"] == "arrived"}
    mistaken = arrived_elsewhere(missions, patrol_steps(run))
    elsewhere = {m["place"] for m in missions if str(m["mission"]) in mistaken}
    barred = _barred(run, facts)
    red, grey = COLOURS["place"], "#777777"
    styles = {"place reached": ("o", red, red), "place not reached": ("o", "none", red),
              "said to be reached, but the robot was elsewhere": ("X", red, "white"),
              "place that cannot be reached": ("o", "white", grey), "place, not asked for": ("o", "none", red)}
    reached, missed, wrong, shut, idle = styles
    used = [reached, missed] if missions and facts.get("places") else []
    for place in facts.get("places", ()):
        name, at = place["name"], (place["x_m"], place["y_m"])
        became = idle if not missions else wrong if name in elsewhere else reached if name in arrived \
            else shut if name in barred else missed
        marker, face, edge = styles[became]
        axes.plot(*at, marker, markersize=7, markerfacecolor=face, markeredgecolor=edge, zorder=5)
        axes.annotate(name, at, xytext=(6, 6), textcoords="offset points", fontsize=8, zorder=6,
                      bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1})
        used.append(became)
    for label in dict.fromkeys(used):
        marker, face, edge = styles[label]
        axes.plot([], [], marker, markerfacecolor=face, markeredgecolor=edge, label=label)


def _barred(run: Run, facts: dict[str, Any]) -> set[str]:
    """Places that the robot is too large to get to, as things stand on the patrol."""
    if (found := run.json("reach")) is None:
        return set()
    _, perhaps = gets_to(found, facts)
    return {place["name"] for place, there in zip(found["places"], perhaps, strict=True) if not there}


def extent(grid: OccupancyGrid) -> tuple[float, float, float, float]:
    """x_min, x_max, y_min, y_max in metres, for imshow."""
    height, width = grid.shape
    x, y = grid.origin_m
    return x, x + width * grid.resolution_m, y, y + height * grid.resolution_m


def _number(row: dict[str, Any], name: str, pattern: str) -> str:
    value = row.get(name)
    return pattern.format(value) if isinstance(value, int | float) and value == value else ""
