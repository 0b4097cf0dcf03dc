"""The named motions a shot can use (P3), one module a family.

A module with a FLOWS tuple registers its flows there: their parameters are numbers, so that shot files, help
and docs are made from the classes. `attraction`, `formula`, `noise` and `sampled` take more than numbers; the
documents of shot files name them.
"""

from pipeline.flow.catalogue import attractors, cellular, deformations, expansion, linear, vortices

FLOWS: tuple[type, ...] = (
    *linear.FLOWS,
    *vortices.FLOWS,
    *expansion.FLOWS,
    *cellular.FLOWS,
    *attractors.FLOWS,
    *deformations.FLOWS,
)
"""The flows whose parameters are numbers only, in the order of the docs."""

__all__ = ["FLOWS"]
