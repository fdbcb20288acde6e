"""Picture of a replay: position and angle against the step with the three-sigma band, and the top view with walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .replay import FilterRun


def draw(run: FilterRun, title: str, path: Path) -> None:
    """Write a PNG."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplot_mosaic([["x", "top"], ["y", "top"], ["yaw", "top"]], figsize=(13, 7),
                                      width_ratios=[1.0, 1.1], layout="constrained")
    scales = (("x", 0, 1.0, "error in x [m]"), ("y", 1, 1.0, "error in y [m]"), ("yaw", 2, 180 / np.pi, "error in yaw [°]"))
    for name, k, scale, label in scales:
        _band(axes[name], scale * run.errors[:, k], scale * run.sigmas[:, k], run.trusted)
        axes[name].set_ylabel(label)
    axes["yaw"].set_xlabel("view")
    axes["x"].legend(loc="upper left", fontsize=8)
    _top(axes["top"], run)
    figure.suptitle(title)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _band(axes, error: np.ndarray, sigma: np.ndarray, trusted: np.ndarray) -> None:
    steps = np.arange(len(error))
    axes.fill_between(steps, -3 * sigma, 3 * sigma, color="#cfe3f2", label="three sigma", linewidth=0)
    axes.plot(steps, error, color="#c0392b", linewidth=1.2, label="error")
    axes.fill_between(steps, 0, 1, where=~trusted, transform=axes.get_xaxis_transform(), color="#f5b041", alpha=0.35,
                      linewidth=0, label="the filter doubts its walls")
    limit = 1.2 * max(np.abs(error).max(), min(3 * np.median(sigma), 2 * np.abs(error).max()), 1e-3)
    axes.set_ylim(-limit, limit)
    axes.axhline(0.0, color="#888888", linewidth=0.6)


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
