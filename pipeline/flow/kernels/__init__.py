"""Compiled kernels of flows: velocity programs, deformations and what they look up."""
