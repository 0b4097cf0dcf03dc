"""View transforms of a shot: views of OpenColorIO's own configs, and of a studio's."""

from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.post.colour import to_display, view_exactly
from flowsculpt.render.post.view import ACES

SHOT = "title: A\nframes: 1-3\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\n"

CONFIG = """\
ocio_profile_version: 2
search_path: tables
roles: {default: LINEAR, scene_linear: LINEAR}
displays:
  wall:
    - !<View> {name: Plain, colorspace: rooted}
    - !<View> {name: Graded, colorspace: graded}
colorspaces:
  - !<ColorSpace> {name: LINEAR}
  - !<ColorSpace>
    name: rooted
    from_scene_reference: !<ExponentTransform> {value: 2, direction: inverse}
  - !<ColorSpace>
    name: graded
    from_scene_reference: !<FileTransform> {src: half.spi1d, interpolation: linear}
"""
TABLE = "Version 1\nFrom 0.0 1.0\nLength 2\nComponents 1\n{\n0.0\n%s\n}\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "studio.ocio").write_text(CONFIG)
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "half.spi1d").write_text(TABLE % 0.5)
    return tmp_path


def read(folder: Path, said: str):
    file = folder / "a.yaml"
    file.write_text(SHOT + said)
    return read_shot(file)


def told(folder: Path, said: str) -> str:
    with pytest.raises((ShotError, MissingInputError)) as error:
        read(folder, said)
    return str(error.value).replace(f"{folder}/", "")


def test_aces_is_the_view_of_a_shot_that_says_nothing(tmp_path):
    assert read(tmp_path, "").picture.view == read(tmp_path, "view: {}\n").picture.view == ACES


def test_a_view_of_the_built_in_config_is_shown(tmp_path):
    view = read(tmp_path, "view: {view: Un-tone-mapped, display: sRGB - Display}\n").picture.view
    assert (view.view, view.movie, view.still) == ("Un-tone-mapped", "sRGB - Display", "sRGB - Display")
    light = np.full((1, 1, 3), 0.5, np.float32)
    np.testing.assert_allclose(to_display(light, view=view), 0.735, atol=0.002)


def test_a_studios_own_config_is_obeyed(folder):
    view = read(folder, "view: {config: studio.ocio, space: LINEAR}\n").picture.view
    assert (view.view, view.movie, view.still) == ("Plain", "wall", "wall")
    light = np.random.default_rng(1).random((8, 8, 3)).astype(np.float32)
    np.testing.assert_allclose(view_exactly(light, view=view), np.sqrt(light), atol=1e-4)
    np.testing.assert_allclose(to_display(light, view=view), np.sqrt(light), atol=1 / 255)


def test_the_files_of_a_config_decide_and_not_where_they_lie(folder, tmp_path_factory):
    said = "view: {config: studio.ocio, space: LINEAR, view: Graded}\n"
    shot = read(folder, said)
    assert {path.name for path, _ in shot.files} == {"studio.ocio", "half.spi1d"}
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "studio.ocio").write_text(CONFIG)
    (elsewhere / "half.spi1d").write_text(TABLE % 0.5)
    assert read(elsewhere, said).picture.display.data == shot.picture.display.data
    (folder / "tables" / "half.spi1d").write_text(TABLE % 0.25)
    assert read(folder, said).picture.display.data != shot.picture.display.data


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("view: {viewx: x}", "a.yaml:5:8: view.viewx: unknown name. Did you mean 'view'?"),
        (
            "view: {view: Plane, config: studio.ocio, space: LINEAR}",
            "has no view 'Plane'. Did you mean 'Plain'?",
        ),
        ("view: {display: sRGB}", "ocio://default has no display 'sRGB'. Did you mean 'sRGB - Display'?"),
        ("view: {config: studio.ocio}", "does not say which of its spaces is linear Rec.709"),
        ("view: {config: studio.ocio, space: LINEER}", "has no space 'LINEER'."),
        ("view: {config: none.ocio}", "file none.ocio is not there"),
        ("view: {config: a.yaml}", "a.yaml is not an OpenColorIO config with a display"),
        ("view: {config: ocio://nonsense}", "ocio://nonsense is not an OpenColorIO config with a display"),
    ],
)
def test_a_view_that_is_not_there_is_told_in_one_line(folder, said, message):
    found = told(folder, said + "\n")
    assert found.startswith("a.yaml:5:") and message in found and "\n" not in found


def test_light_is_computed_in_the_space_that_a_shot_names(tmp_path):
    assert read(tmp_path, "").picture.working_space.name == "rec709"
    picture = read(tmp_path, "working_space: acescg\nview: {view: Un-tone-mapped}\n").picture
    assert picture.working_space.name == picture.view.working_space == "acescg"
    assert picture.display.data != read(tmp_path, "view: {view: Un-tone-mapped}\n").picture.display.data
    assert "Did you mean 'acescg'?" in told(tmp_path, "working_space: ACEScg\n")


def test_a_config_of_a_later_opencolorio_is_refused_for_its_version(folder: Path) -> None:
    (folder / "later.ocio").write_text(
        CONFIG.replace("ocio_profile_version: 2", "ocio_profile_version: 2.99")
    )
    found = told(folder, "view: {config: later.ocio}\n")
    assert "is version 2.99. This version of the OpenColorIO library (" in found
    assert found.count("later.ocio") == 1 and "\n" not in found


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_tables_of_a_config_of_another_encoding_are_known(folder: Path, encoding: str) -> None:
    said = "view: {config: studio.ocio, view: Graded, space: LINEAR}\n"
    (folder / "studio.ocio").write_bytes(CONFIG.encode(encoding))
    before = read(folder, said).picture.view.digest
    (folder / "tables" / "half.spi1d").write_text(TABLE % 0.25)
    assert read(folder, said).picture.view.digest != before


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ((TABLE % 0.5).encode("utf-8-sig"), "half.spi1d: it is UTF-16, has a byte order mark or lines"),
        ((TABLE % 0.5).encode("utf-16"), "half.spi1d: it is UTF-16, has a byte order mark or lines"),
        ((TABLE % 0.5).replace("\n", "\r").encode(), "lines that end in CR, which OpenColorIO does not read"),
        ((TABLE % "0,5").encode(), "half.spi1d: line 7: 0,5 is not a number; decimals have a point"),
    ],
)
def test_a_table_that_opencolorio_would_misread_is_refused(folder: Path, content: bytes, fault: str) -> None:
    (folder / "tables" / "half.spi1d").write_bytes(content)
    assert fault in told(folder, "view: {config: studio.ocio, view: Graded}\n")
