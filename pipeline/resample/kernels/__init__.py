"""Compiled kernels of resampling: arrays in, arrays or counts out."""
