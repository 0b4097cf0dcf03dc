"""Parameters of commands: annotated types that typer reads, and the values of options that several share."""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
