"""A show begins with one command in any folder, and what is there already stays."""

import json
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from flowsculpt.pipeline.plugins.authoring.shot_templates import SHARED
from flowsculpt.pipeline.shot import read_film, read_shot
from tests.conftest import ProjectFolder
from tests.needed_plugins import needs_plugins

OWN = """\
title: Mine
frames: 1-4
subject: {solid: box, size: [1, 1, 1]}
resample: {max_edge_length: 0.5}
flows: [{twist: {amount: 2}}]
"""


@pytest.fixture
def show(tmp_path):
    folder = ProjectFolder(tmp_path)
    done = folder.call("new", "--show", "reel_2030")
    assert done.code == 0 and not done.err
    assert done.out.endswith("Go on: cd reel_2030; flowsculpt preview A010_first; flowsculpt film\n")
    return ProjectFolder(tmp_path / "reel_2030")


@needs_plugins("preview")
@pytest.mark.slow
def test_a_new_show_is_valid_and_can_be_looked_at_and_filmed_at_once(show):
    assert show.call("validate").out.startswith("Good: A010_first, film\n")
    picture = show.call("preview", "A010_first", "--at", "40")
    assert picture.code == 0
    assert (show.path / "renders/A010_first/preview/A010_first.0040.png").is_file()
    planned = show.call("--dry-run", "film")
    assert planned.code == 0 and "rendering 72 frames" in planned.out
    assert read_film(show.path / "shots/film.yaml").title == "Reel 2030"


@pytest.mark.slow
def test_git_ignores_what_is_made_and_editors_find_the_schemas(show):
    assert (show.path / ".gitignore").read_text().split() == ["/renders/", "/.flowsculpt/", "/.snakemake/"]
    settings = json.loads((show.path / ".vscode/settings.json").read_text())
    assert all((show.path / schema).is_file() for schema in settings["yaml.schemas"])
    for file in (show.path / "shots").glob("*.yaml"):
        first, _, _ = (text := file.read_text()).partition("\n")
        schema = json.loads((file.parent / first.partition("$schema=")[2]).read_text())
        jsonschema.Draft202012Validator(schema).validate(YAML(typ="safe").load(text))


def test_shots_of_a_show_leave_to_its_defaults_what_these_give(show):
    assert show.call("new", "A020_ring", "--from", "vortex_ring").code == 0
    for name in ("A010_first", "A020_ring"):
        text = (show.path / f"shots/{name}.yaml").read_text()
        assert not [line for line in text.splitlines() if line.partition(":")[0] in SHARED]
        assert read_shot(show.path / f"shots/{name}.yaml").rate.fps == 24


@pytest.mark.parametrize(
    ("given", "has_set"), [("rate: 25", True), ("stage: plinth", False), ("set: spot", False)]
)
def test_a_new_shot_is_in_a_place_unless_the_show_has_chosen_its_own(show, given, has_set):
    (show.path / "shots/defaults.yaml").write_text(f"{given}\n")
    assert show.call("new", "A020_ring", "--from", "vortex_ring").code == 0
    path = show.path / "shots/A020_ring.yaml"
    assert ("\nset: window" in path.read_text()) == has_set
    assert read_shot(path).picture.stage.kind == ("window" if has_set else "plinth")


@pytest.mark.slow
def test_what_is_in_the_folder_stays_and_is_listed(tmp_path):
    folder = ProjectFolder(tmp_path)
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots/Mine.yaml").write_text(OWN)
    (tmp_path / ".gitignore").write_text("/secret/\n")
    before = read_shot(tmp_path / "shots/Mine.yaml")
    done = folder.call("new", "--show")
    assert done.code == 0 and ".gitignore: kept as it is" in done.out
    assert (tmp_path / ".gitignore").read_text() == "/secret/\n"
    assert read_shot(tmp_path / "shots/Mine.yaml") == before, "the defaults of a show change no shot"
    assert [clip.shot.name for clip in read_film(tmp_path / "shots/film.yaml").clips] == ["Mine"]
    assert not (tmp_path / "shots/A010_first.yaml").exists()
    again = json.loads(folder.call("--json", "new", "--show").out)
    assert again["written"] == [] and "shots/film.yaml" in again["kept"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("new",), "new needs the name of a shot"),
        (("new", "--show", "--from", "twisst"), "Did you mean 'twist'?"),
        (("new", "--show", "a.txt"), "a.txt is a file"),
    ],
)
def test_a_show_that_cannot_begin_is_told_in_one_line(tmp_path, words, says):
    Path(tmp_path / "a.txt").touch()
    done = ProjectFolder(tmp_path).call(*words)
    assert done.code == 2 and says in done.err and done.err.count("\n") == 1
    assert not (tmp_path / "shots").exists()
