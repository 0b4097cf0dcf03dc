"""Shots: the contents of a shot file as values, and how they are read.

Names are imported on first use: reading shots takes half a second of imports, which many users of this
package do not need.
"""

from flowsculpt import lazy_names

__all__, __getattr__ = lazy_names(__name__, __file__)
