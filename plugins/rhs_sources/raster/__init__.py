"""A software rasteriser: textured flat faces, one view in a few milliseconds, the same bytes on every machine."""
