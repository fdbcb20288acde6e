"""Wheels, and vision fused with wheels."""
