"""The conformance kit: checks of every kind of plugin, and small rooms with truth."""
