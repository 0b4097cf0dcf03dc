"""Frames and sound into movies."""
