"""Kalman and particle filters, pose hypotheses, pose graphs."""
