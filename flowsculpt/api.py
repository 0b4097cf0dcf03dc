"""The public API of plug-ins: what they may import. All else, but the names of `flowsculpt`, may change.

Each name is imported from its module when first used, so that the module of a `Plugin` costs no command time.
"""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
