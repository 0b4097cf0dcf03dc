"""Courses: sub-steps along velocity fields, as the kernels take them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import AnyArray, Floats, Indices, Points
from pipeline.flow import _kernels_halving as halving
from pipeline.flow import _kernels_velocity as kernels
from pipeline.flow.flow import for_kernels

WORTH_SHARING = 8000  # steps of points: fewer are done before a second thread has begun


class Course(NamedTuple):
    """Sub-steps along velocity fields, one after another, as a kernel takes them.

    kinds    int32 (K,), the kinds of all the fields
    tables   float64, their tables, flat
    steps    int64 (S, 6): the first field of each sub-step, the one after its last, where its tables begin,
             how often a point may halve it, and what tables there are (see `_kernels_halving.follow`)
    spans    float64 (S, 3): seconds; and how large, in scene units, error and way of a sub-step may be
    owners   of the memory whose addresses stand in the tables
    halved   whether points may halve the sub-steps
    """

    kinds: Indices
    tables: Floats
    steps: AnyArray
    spans: Floats
    owners: tuple[Any, ...] = ()
    halved: bool = False

    @classmethod
    def joined(cls, courses: Sequence[Course]) -> Course:
        """All of them in order, as one. They are of one kind, `halved` or not."""
        shift, steps = np.zeros(6, np.int64), []
        for course in courses:
            steps.append(course.steps + shift)
            shift[:3] += (len(course.kinds), len(course.kinds), len(course.tables))
        return cls(
            np.concatenate([course.kinds for course in courses]),
            np.concatenate([course.tables for course in courses]),
            np.concatenate(steps),
            np.concatenate([course.spans for course in courses]),
            tuple({id(owner): owner for course in courses for owner in course.owners}.values()),
            courses[0].halved,
        )

    def follow(self, points: Points) -> Points:
        """Where points (N, 3) are at its end; not finite where it is too coarse for the point's way."""
        points = for_kernels(points)
        out = np.empty_like(points)
        together = len(points) * len(self.spans) > WORTH_SHARING
        if self.halved:
            kernel = halving.follow_together if together else halving.follow
        else:
            kernel = kernels.advect_together if together else kernels.advect
        kernel(points, *self[:4], out)
        return out
