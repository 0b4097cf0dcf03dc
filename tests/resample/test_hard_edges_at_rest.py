"""With exact placement the surface at rest decides what is hard; otherwise each frame does (P29, P32)."""

import math
from itertools import pairwise

import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.mesh import dihedral_angles, rod, sheet, validate
from flowsculpt.pipeline.resample import Chord, Exact, Resampler, Thresholds
from flowsculpt.pipeline.resample.placement import REST


def test_a_corner_at_rest_stays_though_the_flow_unbends_it() -> None:
    """A square cloth is carried onto a disc, whose rim is as straight at its four corners as elsewhere."""

    def carry(points: Points) -> Points:
        u, v = points[:, 0], points[:, 2]
        disc = u * np.sqrt(1 - v * v / 2), 0 * u, v * np.sqrt(1 - u * u / 2)
        return 0.4 * np.column_stack(disc)

    resampler = Resampler(sheet((2, 2), 0.1), Thresholds(0.2), Exact(carry))
    resampler.vertices[:] = carry(resampler.vertices)
    report = resampler.resample()
    assert report.collapses > 100
    mesh = resampler.mesh
    corners = mesh.attributes[REST][np.abs(mesh.attributes[REST]).sum(axis=1) == 2]
    assert {(float(x), float(z)) for x, _, z in corners} == {(-1, -1), (-1, 1), (1, -1), (1, 1)}
    edges = mesh.halfedge_ends
    border = edges[np.isnan(dihedral_angles(mesh))]
    turns = np.bincount(border.ravel())
    assert (turns[turns > 0] == 2).all(), "one loop around"


@pytest.mark.parametrize("exact", [False, True])
def test_p32_a_tendril_keeps_its_length_and_stays_a_tube_with_hard_edges_and_without(exact: bool) -> None:
    """Drawn out to twenty times its length: hard by its angles now, while nothing is hard at rest."""
    stretch = [1.0]

    def carry(points: Points) -> Points:
        return points * (stretch[0] ** -0.5, stretch[0], stretch[0] ** -0.5)

    placement = Exact(carry) if exact else Chord()
    resampler = Resampler(rod(2.0, 0.3, 0.1), Thresholds(0.16), placement)
    assert not len(resampler.mesh.creases)
    for before, stretch[0] in pairwise(np.geomspace(1, 20, 61)):
        more = stretch[0] / before
        resampler.vertices[:] *= more**-0.5, more, more**-0.5
        report = resampler.resample()
    mesh = resampler.mesh
    assert (np.nan_to_num(dihedral_angles(mesh)) > math.radians(40)).mean() > 0.1
    assert ("feature" in report.refused) != exact
    assert validate(mesh).require(closed=True).euler == 2
    assert np.ptp(mesh.vertices[:, 1]) > 0.97 * 40
    ends = mesh.vertices[mesh.faces][:, :, 1]
    heights = np.linspace(-19, 19, 77)
    through = [np.count_nonzero((ends.min(axis=1) < y) & (ends.max(axis=1) >= y)) for y in heights]
    assert min(through) >= 3, "at every height there is a tube"
