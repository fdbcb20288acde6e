"""Readers of bags of ROS 1 and ROS 2: their files and topics, messages, depth, wheels and truth."""
