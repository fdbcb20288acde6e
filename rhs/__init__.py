"""Robotic Home Sentinel: camera to patrol, as an experiment."""
