"""Files read within limits, written whole or not at all, kept or parsed apart, and pages for browsers."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
