"""First-party sources of rhs."""
