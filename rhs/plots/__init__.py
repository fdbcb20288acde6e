"""Figures that draw into memory and are the same file when they show the same thing; for tasks and reports."""

from .figure import draw_errors, new_figure, save

__all__ = ["draw_errors", "new_figure", "save"]
