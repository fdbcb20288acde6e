"""Registration of the point clouds of a lidar."""
