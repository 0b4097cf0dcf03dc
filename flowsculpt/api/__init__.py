"""What plug-ins add, and the errors and words that all of them share; the facades beside it have the rest."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
