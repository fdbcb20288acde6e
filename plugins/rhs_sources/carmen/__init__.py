"""Laser logs of CARMEN, the robot navigation toolkit."""
