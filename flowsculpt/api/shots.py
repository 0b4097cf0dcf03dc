"""Shot files as values, their entries, and messages about them by line and column."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
