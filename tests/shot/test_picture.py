"""The shape of pictures: what shots, defaults and edits say of it, and what follows from it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.shot import read_film, read_shot
from flowsculpt.render.scene.render_quality import QUALITIES

pytestmark = pytest.mark.quick

SHOT = "title: A\nframes: 1-2\nsubject: {solid: box, size: [2, 2, 2]}\nresample: off\n"


def sizes(picture: str) -> list[tuple[int, int]]:
    """Return the sizes of draft, daily and final."""
    qualities = read_shot("a.yaml", f"{SHOT}picture: {picture}\n").picture.qualities
    return [qualities[name].rendered_size for name in QUALITIES]


def view(picture: str, camera: str):
    path = read_shot("a.yaml", f"{SHOT}picture: {picture}\ncamera: {camera}\n").picture.camera
    return path.at(0.0)


@pytest.mark.parametrize(
    ("picture", "expected"),
    [
        ("", [(480, 270), (960, 540), (1920, 1080)]),
        ('{aspect: "16:9"}', [(480, 270), (960, 540), (1920, 1080)]),
        ('{aspect: "9:16"}', [(270, 480), (540, 960), (1080, 1920)]),
        ("{aspect: 9/16}", [(270, 480), (540, 960), (1080, 1920)]),
        ("{aspect: 1}", [(270, 270), (540, 540), (1080, 1080)]),
        ('{aspect: "4:5"}', [(270, 338), (540, 676), (1080, 1350)]),
        ("{aspect: 2.39}", [(646, 270), (1292, 540), (2582, 1080)]),
        ("{size: [3840, 2160]}", [(960, 540), (1920, 1080), (3840, 2160)]),
    ],
)
def test_the_shorter_side_keeps_its_pixels_and_a_size_is_that_of_final(picture, expected) -> None:
    assert sizes(picture) == expected


@given(st.floats(0.2, 5.0))
def test_all_sides_are_even_and_all_qualities_have_about_one_aspect(aspect: float) -> None:
    for (width, height), shorter in zip(sizes(f"{{aspect: {aspect!r}}}"), (270, 540, 1080), strict=True):
        assert (width % 2, height % 2, min(width, height)) == (0, 0, shorter)
        assert width / height == pytest.approx(aspect, rel=0.006)


def test_all_qualities_are_framed_for_the_aspect_of_final(tmp_path: Path) -> None:
    from flowsculpt.pipeline.production.execution.project import Project

    file = tmp_path / "a.yaml"
    file.write_text(f'{SHOT}picture: {{aspect: "4:5"}}\n')
    requests = [Project(tmp_path, 1, variant="scalar_rgb").request(file, name) for name in QUALITIES]
    assert {request.pictures.aspect for request in requests} == {0.8}
    assert len({request.keys.cameras for request in requests}) == 1


def test_an_upright_picture_is_of_a_camera_turned_on_its_side() -> None:
    wide, upright = (view(shape, "{field_of_view: 40}").field_of_view for shape in ("", '{aspect: "9:16"}'))
    assert math.degrees(wide) == pytest.approx(40.0)
    assert math.tan(upright / 2) / (9 / 16) == pytest.approx(math.tan(wide / 2))
    assert view('{aspect: "1:1"}', "{field_of_view: 40}").field_of_view == wide
    lens = "{focal_length: 50, aperture: 2.8}"
    assert view('{aspect: "9:16"}', lens).lens == view("", lens).lens, "blur stays"


def test_a_shape_replaces_an_inherited_one_whatever_its_form(tmp_path: Path) -> None:
    (tmp_path / "defaults.yaml").write_text("picture: {aspect: 1}\n")
    file = tmp_path / "a.yaml"

    def final(text: str, *settings: str) -> tuple[int, int]:
        file.write_text(SHOT + text)
        return read_shot(file, settings=settings).picture.qualities["final"].rendered_size

    assert final("") == (1080, 1080)
    assert final("picture: {size: [1280, 720]}\n") == (1280, 720)
    assert final("picture: {size: [1280, 720]}\n", "picture.aspect=9:16") == (1080, 1920)
    assert final("picture:\n") == (1920, 1080)


def written(folder: Path, **pictures: str) -> Path:
    """Write shots with these pictures, and return the path of their film."""
    for name, picture in pictures.items():
        (folder / f"{name}.yaml").write_text(f"{SHOT}{picture}\n")
    return folder / "film.yaml"


def test_a_film_of_several_shapes_is_refused_unless_it_has_its_own(tmp_path: Path) -> None:
    file = written(tmp_path, A="", B="picture: {aspect: 1}")
    file.write_text("title: Two\nshots: [A, B]\n")
    with pytest.raises(ShotError) as error:
        read_film(file)
    assert str(error.value) == (
        f"{file}:2:12: B has pictures of [1080, 1080] pixels in final, and A of [1920, 1080]; all shots of "
        "a film share one size. Write picture: {size: [1920, 1080]} in the edit."
    )
    file.write_text('title: Two\npicture: {aspect: "9:16"}\nshots: [A, B]\n')
    film = read_film(file)
    assert {shot.picture.qualities["final"].rendered_size for shot in film.shots} == {(1080, 1920)}
    film = read_film(file, settings=("picture.aspect=1",))
    assert {shot.picture.qualities["draft"].rendered_size for shot in film.shots} == {(270, 270)}


def test_a_film_of_wide_pictures_has_no_shape(tmp_path: Path) -> None:
    file = written(tmp_path, A="camera: {projection: dome}")
    file.write_text("title: One\npicture: {aspect: 1}\nshots: [A]\n")
    with pytest.raises(ShotError, match=r"film.yaml:2:1: projection dome has sizes of its own"):
        read_film(file)
