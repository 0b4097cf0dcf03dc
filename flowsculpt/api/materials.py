"""Looks as values: materials, their textures, and the lights and stage around them."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
