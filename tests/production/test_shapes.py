"""Films, crops and sheets of pictures of other shapes than 16:9."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.pipeline.errors import ShotError, UsageError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.estimate import estimate
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_png
from tests.conftest import QUALITY, TINY, ProjectFolder, done
from tests.needed_plugins import needs_plugins

NAME = "T010_tiny"
UPRIGHT = 'title: Upright\ntitle_seconds: 0.2\npicture: {aspect: "9:16"}\n'


@pytest.fixture
def there(project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> Project:
    monkeypatch.chdir(project.path)
    project.shot.write_text(TINY)
    Path("shots/B.yaml").write_text(TINY)
    Path(".flowsculpt").mkdir(exist_ok=True)
    return Project(project.path, 1)


def test_a_film_has_the_shape_of_its_edit_and_its_shot_keeps_its_own(there: Project) -> None:
    Path("shots/up.yaml").write_text(f"{UPRIGHT}shots: [{{shot: {NAME}, frames: 1-2}}]\n")
    done(there.root, there.film(QUALITY, Show().find_edit("up")))
    movie = probe_movie(there.root / "renders" / "film" / QUALITY / "up.mp4")
    assert (movie.width, movie.height) == (54, 96)
    home = there.root / "renders" / "edit" / NAME / "up"
    assert len(list((home / QUALITY / "frames").iterdir())) == 2
    assert not (there.root / "renders" / NAME).exists()
    assert there.request(Show().find_shot(NAME), QUALITY).pictures.quality.rendered_size == (96, 54)
    assert not there.film(QUALITY, Show().find_edit("up")).jobs, "nothing is left to do"


@pytest.mark.quick
def test_a_shot_that_changes_its_shape_is_noticed_though_the_edit_is_cached(there: Project) -> None:
    Path("shots/film.yaml").write_text(f"title: R\nshots: [{NAME}, B]\n")
    there.film("draft", Show().find_edit("film"))
    Path("shots/B.yaml").write_text(f"{TINY}picture: {{aspect: 1}}\n")
    with pytest.raises(ShotError, match=r"B has pictures of \[1080, 1080\] pixels"):
        Project(there.root, 1).film("draft", Show().find_edit("film"))


@pytest.mark.quick
def test_crops_are_parts_of_the_pictures_of_the_shot(there: Project) -> None:
    from flowsculpt.pipeline.cli.options import PictureOptions

    Path("shots/B.yaml").write_text(f'{TINY}picture: {{aspect: "9:16"}}\n')
    crop = PictureOptions(crop="0,0.5,1,1")
    assert crop.quality("draft", there, ["B"]) == "draft.crop0-240-270-480"
    assert crop.quality("draft", there, [NAME]) == "draft.crop0-135-480-270"
    with pytest.raises(UsageError, match="several sizes"):
        crop.quality("draft", there, [NAME, "B"])


@pytest.mark.quick
def test_a_crop_of_pictures_that_had_another_shape_hides_nothing_else_of_its_shot(there: Project) -> None:
    upright = "draft.crop0-240-270-480"
    for quality in ("draft", upright):
        folder = Path("renders", NAME, quality, "statistics")
        folder.mkdir(parents=True)
        statistics = {"key": "", "seconds": {"rendering": 1.0}, "threads": 1, "peak_memory_mib": 1.0}
        (folder / f"{NAME}.0001.json").write_text(json.dumps(statistics))
    assert [each.quality_name for each in there.rendered_requests(Show().find_shot(NAME))] == ["draft"]
    assert estimate(there.pictures([NAME], "daily"), there.root, cores=1).seconds > 0.0
    with pytest.raises(UsageError, match="0,240,270,480 goes beyond the picture, which has 480 × 270 pixels"):
        there.pictures([NAME], upright)


def test_a_wedge_shows_pictures_of_several_shapes_side_by_side(there: Project) -> None:
    from flowsculpt.pipeline.plugins.sheets.wedge import Grid, Wedge

    wedge = Wedge(
        there, Show().find_shot(NAME), Grid.parse(["picture.aspect=9:16,2.39"]), "draft.scale10", at=1
    )
    assert [request.pictures.quality.rendered_size for _, request in wedge.requests] == [(27, 48), (65, 27)]
    (path,) = wedge.draw()
    sheet = read_png(there.root / path)
    vacant = np.count_nonzero((sheet == 38).all(axis=2))
    assert vacant == pytest.approx(2 * 65 * 48, rel=0.05), "places hold the largest of each side"


@needs_plugins("authoring", "maintenance", "review")
def test_review_and_validate_leave_out_a_crop_of_pictures_that_were_larger(finished: ProjectFolder) -> None:
    home = finished.path / "renders" / NAME
    shutil.copytree(home / QUALITY, home / "draft.crop0-0-400-400")
    (home / "tmp" / "frames").mkdir(parents=True)
    reviewed = finished.call("review", NAME)
    assert reviewed.code == 0 and "1 sequence, 6 pictures" in reviewed.out
    assert reviewed.err.count("-q draft --crop 0,0,400,400 are left out") == 1
    assert "Repeat the --set" in reviewed.err
    assert finished.call("validate", NAME).code == 0
    assert finished.call("--dry-run", "clean").code == 0
    larger = finished.call("--dry-run", "review", NAME, "--set", "picture.size=[3840,3840]")
    assert larger.code == 0 and "left out" not in larger.err
