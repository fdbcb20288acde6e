"""Monocular visual odometry over a local map of points: for recordings, wherever one camera is carried."""
