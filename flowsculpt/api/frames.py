"""Frames of shots: requests, plans, keys, the store and its locks, cameras, the history of runs."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
