"""The task places."""
