"""Recordings: writer, reader, ROS messages, scan and recovery of MCAP, Rerun."""
