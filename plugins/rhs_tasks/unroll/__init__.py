"""The task unroll."""
