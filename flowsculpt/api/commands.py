"""What commands print, and the project in which they look up shots and run plans."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
