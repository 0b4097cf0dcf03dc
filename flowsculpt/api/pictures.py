"""Pictures and movies: looks, lights, cameras, previews, files, colour, type."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
