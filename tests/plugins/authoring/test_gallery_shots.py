"""The gallery is wherever flowsculpt is: its shots are copied into any show, one by one or all of them."""

import filecmp
import json
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.plugins.authoring import new_command
from flowsculpt.pipeline.plugins.authoring.gallery_shots import GALLERY, gallery_files, gallery_names
from flowsculpt.pipeline.plugins.authoring.new_files import write_new
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.shot import read_shot
from tests.conftest import ProjectFolder
from tests.full_disk import disk_of
from tests.needed_plugins import needed_by, needed_by_gallery, needs_plugins

WALKER = GALLERY / "B200_walker.yaml"
BLOOM = GALLERY / "B060_bloom.yaml"


def keys(root: Path, shots: dict[str, str]) -> dict[str, list[str]]:
    """The keys of meshes and normals at draft of shots, by their names in the gallery."""
    found = {}
    for shot, name in shots.items():
        request = Project(root, 2).request(root / f"shots/{name}.yaml", "draft")
        found[shot] = [
            key(number)
            for part in request.parts
            for number in sorted(part.source.surface_keys.meshes)[::16]
            for key in (part.keys.mesh, part.keys.normals)
        ]
    return found


@pytest.fixture(scope="module")
def keys_of_gallery():
    return keys(GALLERY.parent, {name: name for name in gallery_names()})


@pytest.fixture(scope="module")
def show(tmp_path_factory):
    """A show that is the gallery."""
    folder = tmp_path_factory.mktemp("work")
    done = ProjectFolder(folder).call("new", "--show", "my gallery", "--gallery")
    assert done.code == 0 and not done.err
    assert done.out.endswith("Go on: cd 'my gallery'; flowsculpt preview A010_cube; flowsculpt film\n")
    return ProjectFolder(folder / "my gallery")


@needs_plugins(*needed_by_gallery())
@pytest.mark.slow
def test_a_show_of_the_gallery_holds_its_files_and_has_its_keys(show, keys_of_gallery):
    assert all(filecmp.cmp(file, show.path / name, shallow=False) for name, file in gallery_files().items())
    others = [file.name for file in gallery_files().values() if file.suffix != ".yaml"]
    texts = {name: (GALLERY / f"{name}.yaml").read_text() for name in gallery_names()}
    names = {name: name for name, text in texts.items() if any(file in text for file in others)}
    assert len(names) >= 3, "shots that read other files, which must be found from here too"
    assert keys(show.path, names) == {name: keys_of_gallery[name] for name in names}
    assert not (show.path / "shots/defaults.yaml").exists(), "the gallery has none"


@needs_plugins(*needed_by_gallery())
@pytest.mark.slow
def test_a_shot_of_the_gallery_has_its_keys_also_under_another_name(tmp_path, keys_of_gallery, monkeypatch):
    folder = ProjectFolder(tmp_path)
    folder.call("new", "--show")
    monkeypatch.setattr(new_command, "write_schemas", lambda _: None)  # they take most of the time
    names = {name: f"Z{number:02}" for number, name in enumerate(gallery_names())}
    for shot, name in names.items():
        done = folder.call("new", name, "--from", shot)
        assert done.code == 0 and not done.err, (done.err, "the defaults of a new show change no shot")
    (moved := tmp_path / "moved").mkdir()
    (tmp_path / "shots").rename(moved / "shots")
    assert keys(moved, names) == keys_of_gallery, "it reads nothing from elsewhere, either"


@needs_plugins(*needed_by(WALKER))
def test_models_and_sounds_of_the_gallery_come_along_once(tmp_path):
    folder = ProjectFolder(tmp_path)
    first, again, sound = (
        json.loads(folder.call("--json", "new", name, "--from", shot).out)["files"]
        for name, shot in (("A1", "B200_walker"), ("A2", "B200_walker"), ("A3", "B130_pulse"))
    )
    assert first == ["shots/A1.yaml", "shots/models/B200_walker.glb"] and again == ["shots/A2.yaml"]
    assert sound == ["shots/A3.yaml", "shots/pulse.opus"]


def test_a_shot_of_the_show_wins_over_one_of_the_gallery(tmp_path):
    folder = ProjectFolder(tmp_path)
    folder.call("new", "B060_bloom")
    assert folder.call("new", "A020", "--from", "B060_bloom").code == 0
    assert "twist" in (tmp_path / "shots/A020.yaml").read_text()


@needs_plugins(*needed_by(BLOOM))
def test_a_copy_that_the_defaults_of_the_show_change_is_told(tmp_path):
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots/defaults.yaml").write_text("camera: {roll: 5}\nlook: clay\n")
    done = ProjectFolder(tmp_path).call("new", "A020", "--from", "B060_bloom")
    assert done.code == 0 and "shots/defaults.yaml changes this copy of B060_bloom: camera; " in done.err


@pytest.mark.parametrize(
    ("words", "taken", "says"),
    [
        pytest.param(
            ("A020", "--from", "B200_walker"),
            "models/B200_walker.glb",
            "with other contents; rename it",
            marks=needs_plugins(*needed_by(WALKER)),
        ),
        (
            ("--show", "--gallery"),
            "models/B200_walker.glb",
            "with other contents; the gallery needs a folder",
        ),
        (("--show", "--gallery"), "film.yaml", "with other contents; the gallery needs a folder of its own"),
        (("--show", "--gallery"), "defaults.yaml", "would change the gallery's shots; the gallery needs"),
    ],
)
def test_a_file_of_the_show_is_never_replaced_by_one_of_the_gallery(tmp_path, words, taken, says):
    (tmp_path / "shots/models").mkdir(parents=True)
    (tmp_path / "shots" / taken).write_text("mine")
    done = ProjectFolder(tmp_path).call("new", *words)
    assert done.code == 2 and f"shots/{taken} " in done.err and says in done.err
    assert [file.read_text() for file in tmp_path.rglob("*") if file.is_file()] == ["mine"]


@needs_plugins(*needed_by(WALKER))
def test_a_full_disk_leaves_no_half_file_and_no_shot_without_its_model(tmp_path):
    folder, words = ProjectFolder(tmp_path), ("new", "A020", "--from", "B200_walker")
    folder.call("new", "A010")  # writes the schemas
    with disk_of(100_000):
        done = folder.call(*words)
    assert done.code == 4 and "shots/models/B200_walker.glb: cannot be written: " in done.err
    assert not [*(tmp_path / "shots/models").iterdir()] and not (tmp_path / "shots/A020.yaml").exists()
    assert folder.call(*words).code == 0
    assert read_shot(tmp_path / "shots/A020.yaml").title == "A020"


@pytest.mark.parametrize("other", ["ours", "theirs"])
def test_of_two_that_write_one_file_at_once_the_first_one_stays(tmp_path, other):
    file = tmp_path / "A020.yaml"

    def write(draft: Path) -> None:
        file.write_text(other)  # somebody else's command, after ours has looked
        draft.write_text("ours")

    if other == "ours":
        write_new({file: write})
    else:
        with pytest.raises(UsageError, match=r"A020.yaml is there already; choose another name"):
            write_new({file: write})
    assert file.read_text() == other and [*tmp_path.iterdir()] == [file]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ("A020", "--from", "B06_bloom"),
            "'B06_bloom' is neither a flow nor a shot. Did you mean 'B060_bloom'?",
        ),
        (("A020", "--gallery"), "flowsculpt new --show NAME --gallery"),
        (("--show", "--gallery", "--from", "lorenz"), "leave --from lorenz out"),
    ],
)
def test_what_the_gallery_does_not_give_is_told_in_one_line(tmp_path, words, says):
    done = ProjectFolder(tmp_path).call("new", *words)
    assert done.code == 2 and says in done.err and done.err.count("\n") == 1
    assert not [*tmp_path.iterdir()]
