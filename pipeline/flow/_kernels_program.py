"""Velocity programs, run on a block of points: which code obeys which opcode.

To add a leaf
    1. its equation, in a `_kernels_<family>.py`: a kernel of the signature EQUATION that returns the velocity
       at one point, from its row of numbers (at most COLUMNS, listed in its docstring), and a line for it in
       the family's own kernel at the end of that file; a new family gets a line in `_leaf` below;
    2. its opcode, in `_kernels_opcodes`;
    3. its class, in `catalogue/`: a `Term` with `kind`, `row(time)` and `steepness(time)`.

A leaf that needs more numbers than a row holds gets the address of an array in its row, and reads it by
`carray(doubles_at(int(p[o])), n)`; a function compiled at run time is an EXTERNAL (`_kernels_external`). Both
say in `Instruction.identity` what stands for them in keys.

To add a bracket: opcodes in the ranges OPEN…PLACE and CLOSE…UNPLACE, a kernel of the signature BRACKET
(or a weight, for a region), and its lines in `run`.

Numbers decide nothing about the code: other parameters, or another composition, compile nothing.
"""

from __future__ import annotations

from pipeline.arrays import Floats, Indices
from pipeline.flow import _kernels_opcodes as op
from pipeline.flow._kernels_attractor import attractors
from pipeline.flow._kernels_block import LEAVES, LEVEL
from pipeline.flow._kernels_bracket import close_group, close_region, open_group, place, unplace
from pipeline.flow._kernels_cellular import cells
from pipeline.flow._kernels_expansion import expansions
from pipeline.flow._kernels_external import external
from pipeline.flow._kernels_linear import linear
from pipeline.flow._kernels_region import (
    ball_weight,
    box_weight,
    capsule_weight,
    cylinder_weight,
    half_space_weight,
    mesh_weight,
    sampled_weight,
)
from pipeline.flow._kernels_vortex import vortices
from pipeline.kernels import kernel


@kernel(LEAVES)
def _leaf(kind: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Add what one field does, its row at p[o], to n points of the level at s[b]."""
    family = kind // op.FAMILY
    if family == op.TRANSLATION // op.FAMILY:
        linear(kind, p, o, n, s, b)
    elif family == op.LAMB_OSEEN // op.FAMILY:
        vortices(kind, p, o, n, s, b)
    elif family == op.BALL // op.FAMILY:
        expansions(kind, p, o, n, s, b)
    elif family == op.LORENZ // op.FAMILY:
        attractors(kind, p, o, n, s, b)
    elif family == op.ENRIGHT // op.FAMILY:
        cells(kind, p, o, n, s, b)


@kernel("void(i4[::1], i8, i8, f8[::1], i8, i8, f8[::1], i8)")
def run(kinds: Indices, first: int, last: int, p: Floats, o: int, n: int, s: Floats, b: int) -> None:
    """Obey kinds[first:last], rows from p[o] on: add their velocities to n points of the level at s[b].

    `levels(kinds)` levels are used from there on.
    """
    for k in range(first, last):
        kind = kinds[k]
        if kind > op.EXTERNAL:
            _leaf(kind, p, o, n, s, b)
        elif kind == op.EXTERNAL:
            external(p, o, n, s, b)
        elif kind == op.OPEN:
            open_group(p, o, n, s, b)
            b += LEVEL
        elif kind == op.PLACE:
            place(p, o, n, s, b)
            b += LEVEL
        else:
            b -= LEVEL
            if kind == op.CLOSE:
                close_group(p, o, n, s, b)
            elif kind == op.CLOSE_BALL:
                close_region(ball_weight, p, o, n, s, b)
            elif kind == op.CLOSE_BOX:
                close_region(box_weight, p, o, n, s, b)
            elif kind == op.CLOSE_HALF_SPACE:
                close_region(half_space_weight, p, o, n, s, b)
            elif kind == op.CLOSE_CAPSULE:
                close_region(capsule_weight, p, o, n, s, b)
            elif kind == op.CLOSE_CYLINDER:
                close_region(cylinder_weight, p, o, n, s, b)
            elif kind == op.CLOSE_SAMPLED:
                close_region(sampled_weight, p, o, n, s, b)
            elif kind == op.CLOSE_MESH:
                close_region(mesh_weight, p, o, n, s, b)
            else:
                unplace(p, o, n, s, b)
        o += op.COLUMNS
