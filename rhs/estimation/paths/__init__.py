"""Paths over grids: is a line free, and how a path is made shorter."""
