"""Requests: the shot, frames, quality and variant of what is to be rendered."""
