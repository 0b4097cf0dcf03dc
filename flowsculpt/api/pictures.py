"""Pictures and movies: previews, files, cameras, captions, encodes, sound."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
