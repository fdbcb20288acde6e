"""What happened on the way, drawn where it happened: missions and their direction, what the map did not know, detours,
touches, doubt, kidnaps, where the belief was none to trust, and which part complained first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.metrics.calibration import beliefs_of
from rhs.metrics.cause import first_of_failed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Step = Mapping[str, str]
MARKS = (  # events, what the legend says, marker, colour, size
    (("blocked", "replan", "wait", "ask", "skipped"), "way blocked, planned anew", "^", "#e07a00", 7.0),
    (("lost",), "does not know where it is", "$?$", "#7b2cbf", 8.0),
    (("gave_up",), "gave the place up", "X", "#222222", 10.0),
    (("contact",), "touched something", "*", "#c1121f", 8.0),  # last, so above all others
)
BELIEFS = (  # what the legend says, colour, which views of (status, wrong and sure)
    ("on the map, but the map is unsure", "#e9b44c", lambda status, wrong_sure: (status == "degraded") & ~wrong_sure),
    ("in doubt where it is", "#9d6bd0", lambda status, wrong_sure: np.isin(status, ("converging", "lost"))),
    ("wrong, and sure of it", "#c1121f", lambda status, wrong_sure: wrong_sure),
)
ARROW_M = 2.5  # between two arrows on the way driven


def draw_happenings(axes: Axes, steps: Sequence[Step], missions: list[dict[str, Any]]) -> None:
    """Every layer, from the lines of steps.csv and from missions.json."""
    patrol = [step for step in steps if step["phase"] == "patrol"]
    if not patrol:
        return
    way_m = np.array([_stand(step) for step in patrol])
    _draw_beliefs(axes, patrol, way_m)
    _draw_directions(axes, way_m)
    _draw_missions(axes, patrol, way_m)
    _draw_marks(axes, patrol, way_m)
    _draw_kidnaps(axes, patrol, way_m)
    _draw_first(axes, patrol, way_m, missions)


def draw_unknown(axes: Axes, before: OccupancyGrid, after: OccupancyGrid) -> None:
    """What stands there on the patrol and did not on the survey, hatched red; what is gone, hatched grey."""
    if before.shape != after.shape:
        return
    new, gone = after.occupied() & ~before.occupied(), before.occupied() & ~after.occupied()
    for cells, colour, label in ((new, "#c1121f", "new since the survey"), (gone, "#888888", "gone since the survey")):
        if cells.any():
            half = 0.5 * after.resolution_m
            for x, y in after.centres(np.argwhere(cells)):
                axes.fill([x - half, x + half, x + half, x - half], [y - half, y - half, y + half, y + half],
                          facecolor=colour, alpha=0.45, edgecolor="none", zorder=1)
            axes.fill([], [], facecolor=colour, alpha=0.45, label=label)


def draw_moving(axes: Axes, moving: dict[str, Any]) -> None:
    """Lightly: the paths of people, as wide as they are, and doors and things at times; from moving.json."""
    for person in moving.get("people", ()):
        path = np.array([*person["path_m"], person["path_m"][0]])
        axes.plot(*path.T, color="#8ecae6", linewidth=2.5, alpha=0.7, solid_capstyle="round", zorder=1)
        axes.annotate(person["name"], path[0], fontsize=6, color="#3a86a8", zorder=2)
    if moving.get("people"):
        axes.plot([], [], color="#8ecae6", linewidth=2.5, alpha=0.7, label="people's paths")
    for thing in moving.get("timed", ()):
        for corners, style in ((thing["corners_m"], "-"), (thing["otherwise_m"], ":")):
            if corners is not None:
                axes.plot(*np.array([*corners, corners[0]]).T, style, color="#3a86a8", linewidth=1.0, zorder=2)
    if moving.get("timed"):
        axes.plot([], [], color="#3a86a8", linewidth=1.0, label="doors and things at times")


def _stand(step: Step) -> tuple[float, float]:
    """Where the robot was: truly, or as it believed where nobody knows."""
    names = ("true_x_m", "true_y_m") if step.get("true_x_m") else ("x_m", "y_m")
    x, y = (float(step[name] or "nan") for name in names)
    return x, y


def _draw_beliefs(axes: Axes, patrol: Sequence[Step], way_m: np.ndarray) -> None:
    """A band along the way driven wherever the belief was not simply a place, and right where the truth is known."""
    status = np.array([step["belief_status"] for step in patrol])
    beliefs, wrong_sure = beliefs_of(patrol), np.zeros(len(patrol), bool)
    wrong_sure[[bool(step["true_x_m"]) for step in patrol]] = beliefs.sure & ~beliefs.right
    driven = np.stack([way_m[:-1], way_m[1:], np.full_like(way_m[1:], np.nan)], axis=1)  # a stroke for each view, apart
    driven[["kidnapped" in _events(step) for step in patrol[1:]]] = np.nan
    for label, colour, which in BELIEFS:
        strokes = driven[which(status, wrong_sure)[1:]]
        if np.isfinite(strokes).any():
            axes.plot(*strokes.reshape(-1, 2).T, color=colour, linewidth=7.0, alpha=0.35, zorder=2.5, label=label)


def _draw_directions(axes: Axes, way_m: np.ndarray) -> None:
    """Small arrowheads along the way driven."""
    step_m = np.linalg.norm(np.diff(way_m, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(np.nan_to_num(step_m))])
    for at in np.arange(0.5 * ARROW_M, travelled[-1], ARROW_M):
        k = int(np.searchsorted(travelled, at))
        ahead = way_m[k] - way_m[k - 1]
        if 0.02 < np.hypot(*ahead) < 1.0:
            axes.annotate("", way_m[k] + 0.01 * ahead, way_m[k - 1], zorder=4,
                          arrowprops={"arrowstyle": "-|>", "color": "#2a9d5c", "lw": 0, "mutation_scale": 11})


def _draw_missions(axes: Axes, patrol: Sequence[Step], way_m: np.ndarray) -> None:
    """The number of each mission where it begins."""
    begun: set[str] = set()
    for step, at in zip(patrol, way_m, strict=True):
        if step["mission"] not in ("", "0") and step["mission"] not in begun and np.isfinite(at).all():
            begun.add(step["mission"])
            ring = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": "#2a9d5c", "linewidth": 0.8}
            axes.annotate(step["mission"], at, xytext=(-9, -9), textcoords="offset points", fontsize=7, zorder=6, bbox=ring)
    if begun:
        axes.plot([], [], "o", markerfacecolor="white", markeredgecolor="#2a9d5c", label="a mission begins")


def _draw_marks(axes: Axes, patrol: Sequence[Step], way_m: np.ndarray) -> None:
    """One mark where a kind of event begins, not one for each view that it lasts."""
    for events, label, marker, colour, size in MARKS:
        has = np.array([bool(set(events) & _events(step)) for step in patrol])
        begins = np.nonzero(has & ~np.concatenate([[False], has[:-1]]))[0]
        if len(begins):
            style: dict[str, Any] = {"marker": marker, "color": colour, "markersize": size, "linestyle": "none"}
            axes.plot(*way_m[begins].T, **style, zorder=7, label=label)


def _draw_kidnaps(axes: Axes, patrol: Sequence[Step], way_m: np.ndarray) -> None:
    """A dotted line from where the robot was taken to where it was put."""
    label = "carried off"
    for k, step in enumerate(patrol):
        if k and "kidnapped" in _events(step):
            axes.plot(*way_m[k - 1 : k + 1].T, ":", color="#7b2cbf", linewidth=1.1, zorder=2, label=label)
            axes.plot(*way_m[k], "D", color="#7b2cbf", markersize=5, zorder=7)
            label = "_nolegend_"


def _draw_first(axes: Axes, patrol: Sequence[Step], way_m: np.ndarray, missions: list[dict[str, Any]]) -> None:
    """A ring where the first part complained in the first mission that failed, with what it said."""
    complaints = first_of_failed(patrol, missions)
    index = [int(step["index"]) for step in patrol]
    if complaints and complaints[0][0] in index:
        view, words = complaints[0]
        ring: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": "#c1121f", "markeredgewidth": 1.8, "zorder": 8}
        axes.plot(*way_m[index.index(view)], "o", markersize=15, **ring)
        axes.plot([], [], "o", markersize=8, **ring,  # in the legend, where lines are close to each other
                  label=f"trouble began, view {view}: {words.split(' (')[0]}"[:60])


def _events(step: Step) -> set[str]:
    return set(step["event"].split("+"))
