"""Plugins for the tests: light parts that do little, and broken ones."""
