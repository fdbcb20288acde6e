"""Frame to frame: features and rigid motion."""
