"""Compiled kernels of meshes: arrays in, arrays or counts out."""
