"""What a row of a velocity program says to do: the vocabulary of `_kernels_program`.

A program is a list of rows: an opcode and up to `COLUMNS` numbers. Rows are obeyed in order, each on a
whole block of points. A leaf adds its velocity; brackets make compositions part of the same program:

    OPEN … CLOSE        what is between is summed apart, and added with a factor
    OPEN … CLOSE_…      the same with a factor inside of a region, another outside, and a way between
    PLACE … UNPLACE     what is between sees the points in a frame of its own; its velocities are turned back

Brackets nest to any depth. The numbers of a leaf are listed beside its equation.
"""

from __future__ import annotations

COLUMNS = 12
"""Numbers in a row: as many as the widest, a frame, needs."""

OPEN = 1  # no numbers
PLACE = 2  # centre 0:3, matrix 3:12 row by row: within, points are matrix · (point − centre)
CLOSE = 3  # factor 0
CLOSE_BALL = 4  # centre 0:3, radius 3
CLOSE_BOX = 5  # centre 0:3, half its sides 3:6
CLOSE_HALF_SPACE = 6  # point on the plane 0:3, unit normal outwards 3:6
CLOSE_CAPSULE = 7  # centre 0:3, unit axis 3:6, half the length of its line 10, radius 11
CLOSE_CYLINDER = 8  # centre 0:3, unit axis 3:6, half its length 10, radius 11
CLOSE_SAMPLED = 9  # distances at the nodes of a grid: origin 0:3, spacing 3, address of numbers 4
CLOSE_MESH = 10  # a closed surface: where its origin is put 0:3, scale 3, address of numbers 4
# all of a region: falloff 6, factor inside 7, factor outside 8, form of the fall 9 (see `_kernels_region`)
UNPLACE = 11  # -, matrix 3:12: outside, velocities are matrix · velocity

EXTERNAL = 12  # address of a compiled function 0, time 1, its own numbers 2:12 (see `_kernels_external`)

FAMILY = 16
"""Opcodes of a family of leaves follow its number times this."""

TRANSLATION, ROTATION, SCALING, STRAIN = range(16, 20)  # _kernels_linear
LAMB_OSEEN, GAUSSIAN, RANKINE, RING = range(32, 36)  # _kernels_vortex, _kernels_ring
BALL, DISC, SOURCE, SQUEEZE = range(48, 52)  # _kernels_expansion
LORENZ, ROSSLER, AIZAWA, THOMAS, CHUA, HALVORSEN, CHEN = range(64, 71)  # _kernels_attractor
ENRIGHT, ABC, TAYLOR_GREEN, DOUBLE_GYRE, KNEADING = range(80, 85)  # _kernels_cellular
