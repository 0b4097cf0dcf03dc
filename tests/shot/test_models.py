"""Models stand in the shot as its subject says: turned upright, scaled or fitted, repaired or refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MeshError, ShotError
from flowsculpt.pipeline.mesh import TriangleMesh, rod
from flowsculpt.pipeline.shot import Model, Shot, read_shot
from flowsculpt.pipeline.shot.subjects import as_data
from tests.mesh_files import write_ply

SHOT = "title: A\nframes: 1-2\nsubject: {model: a.ply%s}\nresample: off\nflows: []\n"
LONG = rod(4.0, 0.5)  # along y
PLACED = (3.0, -2.0, 7.0)


def shot_of(folder: Path, settings_of_model: str = "", mesh: TriangleMesh | None = None) -> Shot:
    mesh = LONG.with_vertices(LONG.vertices + PLACED) if mesh is None else mesh
    write_ply(mesh, folder / "a.ply")
    (folder / "a.yaml").write_text(SHOT % settings_of_model)
    return read_shot(folder / "a.yaml")


def extent(shot: Shot) -> list[float]:
    low, high = shot.motion.mesh_at_rest().bounds
    return [round(float(x), 6) for x in high - low]


def test_a_fitted_model_has_its_largest_extent_and_its_middle_at_the_origin(tmp_path: Path) -> None:
    shot = shot_of(tmp_path, ", fit: 2")
    low, high = shot.motion.mesh_at_rest().bounds
    assert (high - low).max() == pytest.approx(2.0)
    assert high + low == pytest.approx([0, 0, 0], abs=1e-12)
    assert shot.motion.polygons_at_rest().bounds == pytest.approx(np.stack([low, high]))


def test_a_model_without_settings_is_where_its_file_has_it(tmp_path: Path) -> None:
    placed = shot_of(tmp_path).motion.mesh_at_rest()
    assert placed.vertices == pytest.approx(LONG.vertices + PLACED)
    assert shot_of(tmp_path, ", scale: 3").motion.mesh_at_rest().vertices == pytest.approx(
        3 * placed.vertices
    )


def test_a_file_with_z_up_is_turned_upright(tmp_path: Path) -> None:
    upright = shot_of(tmp_path, ", up: z").motion.mesh_at_rest().vertices
    x, y, z = (LONG.vertices + PLACED).T
    assert upright == pytest.approx(np.column_stack([x, z, -y]))


@pytest.mark.parametrize(
    ("rotate", "sides"),
    [
        ("[90, 0, 0]", [1, 1, 5]),
        ("[0, 90, 0]", [1, 5, 1]),
        ("[0, 0, 90]", [5, 1, 1]),
        ("[90, 90, 0]", [5, 1, 1]),
    ],
)
def test_a_model_is_turned_about_x_then_y_then_z(tmp_path: Path, rotate: str, sides: list[float]) -> None:
    box = rod(5.0, 0.5, caps="flat")
    assert extent(shot_of(tmp_path, f", rotate: {rotate}", box)) == pytest.approx(sides, abs=0.1)


@settings(max_examples=20, deadline=None)
@given(
    st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9)),
    st.sampled_from("yz"),
    st.floats(1e-3, 1e4),
)
def test_turning_and_fitting_change_no_shape(rotate: Any, up: str, fit: float) -> None:
    turned = Model("", up=up, rotate=rotate, fit=fit)._placed(LONG.vertices)
    lengths = np.linalg.norm(np.diff(LONG.vertices, axis=0), axis=1)
    factor = np.linalg.norm(np.diff(turned, axis=0), axis=1) / lengths
    assert np.ptp(factor) < 1e-9 * factor[0]
    assert np.ptp(turned, axis=0).max() == pytest.approx(fit)


def test_fit_and_scale_together_are_refused_with_what_to_write(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match=r"a\.yaml:3:35: fit and scale both set .* leave the other"):
        shot_of(tmp_path, ", scale: 2, fit: 2")


def test_settings_at_their_defaults_leave_keys_as_they_were() -> None:
    plain = {"is": "Model", "digest": "abc", "scale": 1.0}
    assert as_data(Model("abc")) == plain
    assert as_data(Model("abc", up="z", fit=2.0)) == plain | {"up": "z", "fit": 2.0}
    assert as_data(Model("abc", repair=False, rotate=(0.0, 1.0, 0.0))) == plain | {
        "rotate": [0.0, 1.0, 0.0],
        "repair": False,
    }


def test_a_faulty_model_is_repaired_and_told_unless_repair_is_off(tmp_path: Path) -> None:
    faces = LONG.faces.copy()
    faces[::2] = faces[::2, ::-1]
    wrong = TriangleMesh(LONG.vertices, faces)
    subject = shot_of(tmp_path, "", wrong).motion.subject
    assert list(subject.notes) == [], "the file has not been read yet"
    subject.build()
    assert "wound against their neighbours" in subject.notes[0]
    with pytest.raises(MeshError, match=r"wound against their neighbours.*\. Write repair: on, or repair"):
        shot_of(tmp_path, ", repair: off", wrong).motion.mesh_at_rest()


def test_a_model_far_from_the_origin_is_told_unless_it_is_fitted(tmp_path: Path) -> None:
    far = LONG.with_vertices(LONG.vertices + 1e5)
    for text, told in (("", 1), (", fit: 2", 0)):
        subject = shot_of(tmp_path, text, far).motion.subject
        subject.build()
        assert len(subject.notes) == told
    subject = shot_of(tmp_path, "", LONG).motion.subject
    subject.build()
    assert not subject.notes


def test_coordinates_that_a_file_holds_too_coarsely_are_told_even_if_it_is_fitted(tmp_path: Path) -> None:
    rounded = (LONG.vertices + 1e6).astype(np.float32).astype(np.float64)
    subject = shot_of(tmp_path, ", fit: 2", LONG.with_vertices(rounded)).motion.subject
    subject.build()
    assert "coordinates of its file are 0.062 apart" in subject.notes[-1]
