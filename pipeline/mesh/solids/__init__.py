"""Solids: their meshes, and their analytic surfaces."""
