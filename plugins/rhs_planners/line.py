"""The test of a straight line for OMPL: one crossing from Python, on a grid known by its address."""

from __future__ import annotations

import numba as nb
import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from rhs.api.jit import typed
from rhs.estimation.paths.line import segment_free


@intrinsic
def _as_pointer(typing_context, address):
    """An integer address as a pointer to bytes."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), generate


@typed(nb.boolean(nb.intp, nb.int64, nb.int64, nb.float64, nb.float64, nb.float64, nb.float64))
def segment_free_at(address, rows, columns, x0, y0, x1, y1):
    """segment_free on the uint8 grid at a memory address: spares unboxing the array on every call from OMPL.

    Ends beyond the grid are not free."""
    if not (0.0 <= min(x0, x1) and max(x0, x1) < columns and 0.0 <= min(y0, y1) and max(y0, y1) < rows):
        return False
    grid = nb.carray(_as_pointer(address), (rows, columns), np.uint8)  # type: ignore[call-arg]  # numba gives the first
    return segment_free(grid, x0, y0, x1, y1)
