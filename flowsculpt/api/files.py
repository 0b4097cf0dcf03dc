"""Files: read within limits, written whole or not at all, kept between runs, parsed in own processes."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
