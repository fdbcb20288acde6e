"""One camera over a known floor, in any building: a window of poses, and the ground found free by looking at it twice."""
