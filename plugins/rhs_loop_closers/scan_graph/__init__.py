"""Loops between laser scans, a planar pose graph, and every scan laid onto its neighbours."""
