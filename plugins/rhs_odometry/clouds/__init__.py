"""Registration of point clouds: KISS-ICP and GICP."""
