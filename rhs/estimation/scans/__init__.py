"""Rays, scan matching, likelihood fields, wall lines."""
