"""The task planning."""
