"""Players are told the projection of a shot, whatever is made of it; a film has one."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import av
import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.keys import projection_of
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.request.render_request import RequestPictures
from flowsculpt.pipeline.shot import read_film
from flowsculpt.render.movie.codecs import ENCODES
from flowsculpt.render.post.image import read_exr, read_header
from flowsculpt.render.scene.render_camera import PERSPECTIVE, Projection
from tests.conftest import QUALITY, TINY, done

NAME = "T010_tiny"
LEVEL = "camera: {azimuth: -30, elevation: 14}"


def shot_with(camera: str) -> str:
    return TINY.replace(LEVEL, f"camera: {{{camera}}}")


@pytest.fixture
def there(project, monkeypatch):
    """A project with a spherical shot and a perspective one, which is the working folder."""
    monkeypatch.chdir(project.path)
    project.shot.write_text(shot_with("projection: spherical"))
    Path("shots/T020_flat.yaml").write_text(TINY)
    return project


def told(path: Path) -> tuple[int, ...] | None:
    """Projection and bounds left, top, right and bottom that FFmpeg reads from a movie; None without."""
    with av.open(str(path)) as container:
        found = next(container.decode(video=0)).side_data.get("SPHERICAL")
    if found is None:
        return None
    kind, _, _, _, *bounds = struct.unpack_from("<i3i4I", bytes(found))
    return kind, *bounds


WHOLE = 0, 0, 0, 0, 0


def test_movies_films_and_stills_of_a_spherical_shot_are_told_to_players(there):
    short = re.sub("keys: .*", "keys: {1: 0, 2: 36}}}", shot_with("projection: spherical"))
    there.shot.write_text(short.replace("1-6", "1-2"))
    Path("shots/film.yaml").write_text(
        f"title: All around\nshots: [{NAME}]\ntitle_seconds: 0.125\ncredits_seconds: 0\n"
    )
    done(there.path, Project(there.path, 1).film(QUALITY, Show().find_edit("film")))
    home, movie = there.path / "renders" / NAME / QUALITY, there.path / f"renders/film/{QUALITY}/film.mp4"
    assert told(home / f"{NAME}.mp4") == told(movie) == WHOLE
    with av.open(str(movie)) as film:
        card, *_, last = (frame.to_ndarray(format="rgb24") for frame in film.decode(video=0))
    height, width = card.shape[:2]
    assert card[height // 2, width // 2].min() > 8, "the card stands straight ahead"
    assert card[:, : width // 4].max() <= 2, "and nothing behind the viewer"
    assert last.mean() > 20, "the frames show the sculpture and its stage"
    frame = home / "frames" / f"{NAME}.0001.exr"
    assert b"envmap\0envmap\0" in frame.read_bytes()[:4000]
    assert read_exr(frame)[0].size == (width, height)
    assert projection_of(read_header(frame)) == Projection("spherical")


def test_a_deliverable_is_told_and_named_for_players(finished, monkeypatch):
    from flowsculpt.pipeline.plugins.delivery.deliverables import Delivery, DeliveryOptions, shot_source

    monkeypatch.chdir(finished.path)
    project = Project(finished.path, cores=1)
    monkeypatch.setattr(RequestPictures, "projection", Projection("vr180"))
    source = shot_source(project.find_request(NAME, QUALITY, FrameRange.parse("2-3")), project.store, {})
    options = DeliveryOptions((ENCODES["h264"], ENCODES["webp"]), slate="head")
    movie, page = Delivery(source, options, project.store).make(lambda name, count: lambda: None)
    quarter = 1 << 30
    assert told(finished.path / movie.path) == (2, quarter, 0, quarter, 0)
    assert (finished.path / page.path).is_file()
    with av.open(str(finished.path / movie.path)) as file:
        slate = next(file.decode(video=0)).to_ndarray(format="gray").astype(int)
    left, right = np.hsplit(slate, 2)
    assert np.abs(left - right).mean() < 2.0 and left.max() > 60, "both eyes see the slate"


@pytest.mark.quick
@pytest.mark.parametrize(("kind", "end"), [("spherical", "_360"), ("vr180", "_180_LR"), ("dome", "")])
def test_names_of_deliverables_say_what_many_players_go_by(there, kind, end):
    from flowsculpt.pipeline.plugins.delivery.timeline import _delivered

    there.shot.write_text(shot_with(f"projection: {kind}"))
    request = Project(there.path, cores=1).find_request(NAME, "draft")
    assert _delivered(request, ENCODES["h264"]).name == f"{NAME}.1-6{end}.h264.mp4"


@pytest.mark.quick
def test_a_shot_has_its_own_projection_beside_a_wide_one(there):
    project = Project(there.path, cores=1)
    assert project.find_request(NAME, "draft").pictures.projection == Projection("spherical")
    assert project.find_request("T020_flat", "draft").pictures.projection == PERSPECTIVE


@pytest.mark.quick
@pytest.mark.parametrize(
    ("first", "second", "says"),
    [
        ("projection: spherical", "", "film.yaml:2:12: B has projection perspective, and A spherical"),
        ("", "projection: vr180", "film.yaml:2:12: B has projection vr180, and A perspective"),
        (
            "projection: dome",
            "projection: dome, dome_angle: 220",
            "film.yaml:2:12: B has projection dome of 220°, and A dome of 180°; all shots of a film share "
            "one. Change one of them, or make a film of each.",
        ),
    ],
)
def test_a_film_of_two_projections_is_refused(first, second, says, tmp_path):
    (tmp_path / "A.yaml").write_text(shot_with(first))
    (tmp_path / "B.yaml").write_text(shot_with(second))
    (tmp_path / "film.yaml").write_text("title: R\nshots: [A, B]\n")
    with pytest.raises(ShotError) as error:
        read_film(tmp_path / "film.yaml")
    assert says in str(error.value)


@pytest.mark.quick
def test_a_shot_that_changes_its_projection_is_noticed_though_the_edit_is_cached(there):
    Path(".flowsculpt").mkdir()
    there.shot.write_text(TINY)
    Path("shots/film.yaml").write_text(f"title: R\nshots: [{NAME}, T020_flat]\n")
    Project(there.path, cores=1).film("draft", Show().find_edit("film"))
    there.shot.write_text(shot_with("projection: spherical"))
    with pytest.raises(ShotError, match="T020_flat has projection perspective, and T010_tiny spherical"):
        Project(there.path, cores=1).film("draft", Show().find_edit("film"))
