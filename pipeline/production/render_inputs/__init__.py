"""Inputs of a render besides the mesh: shading normals, cameras, motion."""
