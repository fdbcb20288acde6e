"""First-party odometry of rhs."""
