"""First-party loop_closers of rhs."""
