"""The opcodes of velocity programs, and where those of each family of fields begin.

A program is a list of rows: an opcode and up to `COLUMNS` numbers. Its rows run in order, each on a whole
block of points. A field adds its velocity; brackets make compositions part of the same program:

    OPEN … CLOSE        the fields between are summed apart, and added with a factor
    OPEN … CLOSE_…      the same, with a factor inside a region, another outside, and a falloff between
    PLACE … UNPLACE     the fields between see points in a transformed frame; velocities are transformed back

Brackets nest to any depth. The numbers of a field are listed beside its equation.
"""

from __future__ import annotations

COLUMNS = 12
"""Numbers in a row: as many as the widest row, a transform, needs."""

OPEN = 1  # no numbers
PLACE = 2  # centre 0:3, matrix 3:12 row by row: inside, points are matrix · (point − centre)
CLOSE = 3  # factor 0
CLOSE_BALL = 4  # centre 0:3, radius 3
CLOSE_BOX = 5  # centre 0:3, half its sides 3:6
CLOSE_HALF_SPACE = 6  # point on the plane 0:3, unit normal outwards 3:6
CLOSE_CAPSULE = 7  # centre 0:3, unit axis 3:6, half the length of its line 10, radius 11
CLOSE_CYLINDER = 8  # centre 0:3, unit axis 3:6, half its length 10, radius 11
CLOSE_SAMPLED = 9  # distances at the nodes of a grid: origin 0:3, spacing 3, address of the numbers 4
CLOSE_MESH = 10  # a closed surface: position of its origin 0:3, scale 3, address of the numbers 4
# all regions: falloff 6, factor inside 7, factor outside 8, type of the falloff 9 (see `regions`)
UNPLACE = 11  # -, matrix 3:12: outside, velocities are matrix · velocity

EXTERNAL = 12  # address of a compiled function 0, time 1, its own numbers 2:12 (see `external`)

FAMILY = 16
"""Opcodes in a family of fields."""

LINEAR, VORTICES, EXPANSION, ATTRACTORS, CELLULAR = 16, 32, 48, 64, 80
"""The first opcode of each family; the module of that name numbers its fields from there."""
