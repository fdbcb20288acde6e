"""Figures that draw into memory and are the same file when they show the same thing; for tasks and reports."""

from .figure import new_figure, save

__all__ = ["new_figure", "save"]
