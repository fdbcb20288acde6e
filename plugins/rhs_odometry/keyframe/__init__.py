"""Key-frame RGB-D odometry."""
