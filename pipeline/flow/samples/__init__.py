"""Velocities sampled on a grid, and the files that hold them."""
