"""matplotlib without pyplot: a figure in memory, saved without date and version."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
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
