"""First-party sensors of rhs."""
