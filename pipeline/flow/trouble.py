"""Why a point was lost: the formula that was not finite on its way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.arrays import Points
from pipeline.flow.catalogue.formula import Formula
from pipeline.flow.flow import Flow
from pipeline.flow.velocity import Streamlines


def trouble(flow: Flow, place: Points, time: float, dt: float) -> str | None:
    """What to tell of a flow that takes the point at `place` (3,) out of the numbers; None where unknown.

    The point is followed once more, slowly, by the same sub-steps.
    """
    if not isinstance(flow, Streamlines):
        return None
    here = np.array(place)
    formulas = any(isinstance(leaf, Formula) for leaf, _ in flow.field.leaves(here, time))
    plain = replace(flow, tolerance=None, stride=None)
    for h in plain.course(time, dt).spans[:, 0] if formulas else ():
        slopes: list[Points] = [np.zeros(3)]
        for share in (0.0, 0.5, 0.5, 1.0):
            at, moment = here + share * h * slopes[-1], time + share * h
            leaves = flow.field.leaves(at, moment)
            told = (leaf.trouble(seen, moment) for leaf, seen in leaves if isinstance(leaf, Formula))
            if found := next(filter(None, told), None):
                return found
            slopes.append(flow.field.velocity(at[None], moment)[0])
        here = here + h / 6.0 * (slopes[1] + 2.0 * (slopes[2] + slopes[3]) + slopes[4])
        time += h
    return None
