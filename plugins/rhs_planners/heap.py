"""A binary heap in two arrays, for compiled searches: smallest key first, lower item first among equal keys."""

from __future__ import annotations

import numba as nb
from numba.core import types

from rhs.api.jit import INNER, typed

KEYS = types.Array(types.float64, 1, "C")
ITEMS = types.Array(types.int64, 1, "C")


@typed(nb.int64(KEYS, ITEMS, nb.int64, nb.float64, nb.int64), **INNER)
def push(keys, items, size, key, item):
    """Put (key, item) into the first `size` entries; returns the new size. The arrays must have room."""
    at = size
    while at > 0:
        up = (at - 1) >> 1
        if keys[up] < key or (keys[up] == key and items[up] <= item):
            break
        keys[at], items[at] = keys[up], items[up]
        at = up
    keys[at], items[at] = key, item
    return size + 1


@typed(nb.int64(KEYS, ITEMS, nb.int64), **INNER)
def pop(keys, items, size):
    """Take the entry at 0 away (read it first); returns the new size."""
    size -= 1
    key, item = keys[size], items[size]
    at = 0
    while True:
        down = 2 * at + 1
        if down >= size:
            break
        right = down + 1
        if right < size and (keys[right] < keys[down] or (keys[right] == keys[down] and items[right] < items[down])):
            down = right
        if key < keys[down] or (key == keys[down] and item <= items[down]):
            break
        keys[at], items[at] = keys[down], items[down]
        at = down
    keys[at], items[at] = key, item
    return size
