"""First-party planners of rhs."""
