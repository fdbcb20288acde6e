"""Laser scans laid onto a map of the last key scans."""
