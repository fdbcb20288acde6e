"""Read a world from its YAML file (format: worlds/README.md) and refuse it, in one line, when something is wrong."""

from __future__ import annotations

from .floorplan import (  # noqa: F401
    Box,
    Paintings,
    Surface,
    Wall,
    World,
    mapping_grid_frame,
    truth_grid,
)
