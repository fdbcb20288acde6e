"""matplotlib without pyplot: a figure in memory, saved without date and version."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def new_figure(width_in: float, height_in: float) -> Figure:
    """A figure of that size in inches that draws into memory only."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path | IO[bytes]) -> None:
    """PNG without date and version: equal pictures are equal files. Laid out as it is drawn, once: `savefig` draws twice."""
    canvas: Any = figure.canvas
    canvas.print_png(path, metadata={"Software": None})


def draw_errors(axes: Axes, error: np.ndarray, sigma: np.ndarray, trusted: np.ndarray) -> None:
    """An error (N,) view by view inside three of the sigmas (N,) that were stated; where nobody trusted (N,) it, shaded."""
    view = np.arange(len(error))
    axes.fill_between(view, -3 * sigma, 3 * sigma, color="#cfe3f2", linewidth=0, label="three sigma")
    axes.plot(view, error, color="#c1121f", linewidth=1.2, label="error")
    if not trusted.all():
        axes.fill_between(view, 0, 1, where=~trusted, transform=axes.get_xaxis_transform(), color="#f5b041", alpha=0.3,
                          linewidth=0, label="the odometry doubts itself")
    largest = float(np.nanmax(np.abs(error)))
    limit = 1.3 * max(largest, min(3.0 * float(np.nanmedian(sigma)), 3.0 * largest), 1e-3)
    axes.set_ylim(-limit, limit)
    axes.axhline(0.0, color="#888888", linewidth=0.6)
