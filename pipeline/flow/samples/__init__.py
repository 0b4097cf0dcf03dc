"""Velocities sampled on a grid: files that hold them, and reading them."""
