"""The named motions a shot can use (P3), one module a family.

Flows whose parameters are numbers stand in the tuple of their module and in FLOWS: shot files, help and docs
are made from their classes. The others are named in the documents of shot files.
"""

from flowsculpt.pipeline.flow.catalogue import basic, deformations, lorenz, vortices

FLOWS: tuple[type, ...] = (
    *basic.LINEAR,
    *vortices.FLOWS,
    *basic.SOURCES,
    *basic.CELLULAR,
    *lorenz.FLOWS,
    *deformations.FLOWS,
)
"""The flows whose parameters are numbers only, in the order of the docs."""

__all__ = ["FLOWS"]
