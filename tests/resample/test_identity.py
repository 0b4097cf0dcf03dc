"""Every vertex of a film has a number of its own, and every birth its record."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.arrays import AnyArray
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere, sheet, torus
from flowsculpt.pipeline.mesh.analytic_surfaces import SphereSurface
from flowsculpt.pipeline.mesh.halfedge_mesh import IDENTITY, ancestry, with_identities
from flowsculpt.pipeline.resample import Chord, Curved, Exact, Placement, Resampler, Thresholds

MENAGERIE = [box(edge_length=0.5), icosphere(6), sheet((2.0, 2.0), 0.3), torus(1.0, 0.4, 0.3)]
WAYS = [(Chord(), "edges"), (Curved(), "edges"), (Chord(), "faces")]
CREEP = 1e-9  # a minimum that nothing falls below

seeds, meshes = st.integers(0, 2**32 - 1), st.sampled_from(MENAGERIE)


def stir(resampler: Resampler, frame: int, seed: int) -> None:
    x, y, z = resampler.vertices.T.copy()
    phase = frame + seed % 7
    resampler.vertices[:] = np.column_stack(
        [1.1 * x + 0.1 * np.sin(2 * y + phase), 0.93 * y + 0.1 * np.sin(3 * z), 0.95 * z + 0.1 * np.sin(x)]
    )


def numbers(resampler: Resampler) -> AnyArray:
    return resampler.mesh.attributes[IDENTITY]


def births(resampler: Resampler) -> AnyArray:
    records = resampler.births
    assert records is not None
    return records


@settings(max_examples=25, deadline=None)
@given(meshes, st.sampled_from(WAYS), seeds)
def test_a_number_is_never_given_twice_and_every_birth_is_on_record(
    mesh: TriangleMesh, way: tuple[Placement, str], seed: int
) -> None:
    placement, splits = way
    resampler = Resampler(with_identities(mesh), Thresholds(0.25), placement, splits=splits)  # type: ignore[arg-type]
    for frame in range(8):
        before, given_before = numbers(resampler), resampler.identities
        stir(resampler, frame, seed)
        report, records = resampler.resample(), births(resampler)
        after = numbers(resampler)
        assert records.dtype == after.dtype == np.int64
        assert len(records) == report.splits and len(after) == len(before) + len(records) - report.collapses
        assert records[:, 0].tolist() == list(range(given_before, resampler.identities))
        assert (records[:, 1] != records[:, 2]).all() and (records[:, 1:] < records[:, :1]).all()
        assert set(records[:, 1:].flat) | set(after) <= set(before) | set(records[:, 0])
        assert len(set(after)) == len(after)


@settings(max_examples=15, deadline=None)
@given(meshes, seeds)
def test_whoever_survives_is_where_it_was(mesh: TriangleMesh, seed: int) -> None:
    """Off the chord merged vertices keep an end, so that a number always goes with its place."""
    resampler, collapses = Resampler(with_identities(mesh), Thresholds(0.25), Curved()), 0
    for frame in range(6):
        stir(resampler, frame, seed)
        places = dict(zip(numbers(resampler).tolist(), resampler.vertices.tolist(), strict=True))
        collapses += resampler.resample().collapses
        for name, place in zip(numbers(resampler).tolist(), resampler.vertices.tolist(), strict=True):
            assert places.get(name, place) == place
    assert collapses > 0


@settings(max_examples=15, deadline=None)
@given(meshes, st.sampled_from(["chord", "faces", "curved"]), seeds)
def test_ancestors_reproduce_an_attribute_to_the_bit(mesh: TriangleMesh, way: str, seed: int) -> None:
    """Whatever is mixed at births alone: all that Curved does, and Chord where nothing collapses."""
    rng = np.random.default_rng(seed)
    tint = rng.integers(-64, 64, (len(mesh.vertices), 3)).astype(float)
    begun = with_identities(mesh).with_attributes(tint=tint, mass=tint[:, 0])
    placement: Placement = Curved() if way == "curved" else Chord()
    thresholds = Thresholds(0.25) if way == "curved" else Thresholds(0.25, CREEP)
    resampler = Resampler(begun, thresholds, placement, splits="faces" if way == "faces" else "edges")
    records = []
    for frame in range(5):
        stir(resampler, frame, seed)
        report = resampler.resample()
        assert way == "curved" or not report.collapses
        records.append(births(resampler))
    after = resampler.mesh
    found = ancestry(after.attributes[IDENTITY], begun.attributes[IDENTITY], np.concatenate(records))
    assert not found.survives.all()
    np.testing.assert_array_equal(found.mixed(tint), after.attributes["tint"])
    np.testing.assert_array_equal(found.mixed(tint[:, 0]), after.attributes["mass"])


@pytest.mark.parametrize("splits", ["edges", "faces"])
def test_points_at_rest_are_the_means_of_their_ancestors(splits: str) -> None:
    """Chord placement without collapses; a cube's grid has coordinates in whole sixteenths."""
    cube = box(edge_length=0.5)
    begun = with_identities(cube.with_attributes(rest=cube.vertices))
    resampler = Resampler(begun, Thresholds(0.2, CREEP), splits=splits)  # type: ignore[arg-type]
    records = []
    for frame in range(4):
        stir(resampler, frame, 0)
        resampler.resample()
        records.append(births(resampler))
    found = ancestry(numbers(resampler), begun.attributes[IDENTITY], np.concatenate(records))
    np.testing.assert_array_equal(found.mixed(cube.vertices), resampler.mesh.attributes["rest"])


@pytest.mark.parametrize(("placement", "splits"), WAYS)
@pytest.mark.parametrize("stop", [1, 4])
def test_numbering_goes_on_from_a_file_as_if_never_stopped(
    placement: Placement, splits: str, stop: int
) -> None:
    def advance(resampler: Resampler, frames: range) -> list[bytes]:
        told = []
        for frame in frames:
            stir(resampler, frame, 3)
            resampler.resample()
            told += [births(resampler).tobytes(), numbers(resampler).tobytes()]
        return told

    begun = with_identities(torus(1.0, 0.4, 0.3))
    straight = Resampler(begun, Thresholds(0.2), placement, splits=splits)  # type: ignore[arg-type]
    advance(straight, range(stop))
    file = io.BytesIO()
    np.savez(file, **straight.state())  # type: ignore[arg-type]
    file.seek(0)
    with np.load(file) as state:
        resumed = Resampler.from_state(state, Thresholds(0.2), placement, splits=splits)  # type: ignore[arg-type]
    assert resumed.identities == straight.identities
    assert advance(resumed, range(stop, 8)) == advance(straight, range(stop, 8))


def test_the_numbers_of_the_dead_are_not_given_again() -> None:
    """Even if the youngest died before the state was kept."""
    state = Resampler(with_identities(icosphere(4)), Thresholds(0.5)).state()
    resumed = Resampler.from_state({**state, "identities": np.array(5000)}, Thresholds(0.2))
    resumed.resample()
    assert births(resumed)[0, 0] == 5000 and numbers(resumed).max() >= 5000


def test_who_dies_in_the_frame_of_its_birth_is_on_record_too() -> None:
    """A long thin sheet: cutting it in two makes medians that are too short."""
    resampler = Resampler(with_identities(sheet((2.0, 0.1), 0.1)), Thresholds(0.2, 0.09))
    resampler.vertices[:] *= [2.3, 0.7, 0.7]
    report = resampler.resample()
    died = set(births(resampler)[:, 0]) - set(numbers(resampler))
    assert report.collapses >= len(died) > 0


def test_identities_change_nothing_else_and_nobody_needs_them() -> None:
    mesh, carried = icosphere(8), [0]
    placement = Exact(lambda points: points * [1.06 ** carried[0], 1.0, 1.0], SphereSurface(1.0))
    told, plain = (Resampler(m, Thresholds(0.2), placement) for m in (with_identities(mesh), mesh))
    for _ in range(8):
        carried[0] += 1
        for each in (told, plain):
            each.vertices[:] *= [1.06, 1.0, 1.0]
        assert told.resample() == plain.resample()
    kept = told.state()
    assert kept.keys() - plain.state().keys() == {f"attribute.{IDENTITY}", "identities"}
    assert all(kept[name].tobytes() == values.tobytes() for name, values in plain.state().items())
    assert plain.births is None and plain.identities == 0


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (np.arange(12.0), r"holds float64 of shape \(12,\); it must be one int64"),
        (np.arange(24).reshape(12, 2), r"holds int64 of shape \(12, 2\)"),
        (np.arange(12, dtype=np.uint8), "holds uint8"),
        (np.arange(12) // 2, "holds a number twice"),
        (np.arange(12) - 1, "below 0"),
        (np.arange(12) + (1 << 53), "over 2"),
    ],
)
def test_numbers_that_tell_no_vertices_apart_are_refused(values: AnyArray, told: str) -> None:
    assert len(icosphere(1).vertices) == 12
    with pytest.raises(MeshError, match=told):
        Resampler(icosphere(1).with_attributes(**{IDENTITY: values}), Thresholds(0.5))
