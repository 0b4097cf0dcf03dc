"""A copy of a shot of another folder names the same files, or copies of them."""

import json
import wave
from pathlib import Path

import pytest

from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.shot import read_shot
from tests.mesh_files import write_ply

SHOT = """\
title: B
intent: tone.wav
frames: 1-2
subject: {{model: {model}, fit: 2}}
resample: off
flows:
  - become: {{model: "{model}", fit: 2, detail: coarse}} # comments stay
sound: {{file: {sound}}}
"""


def write_sound(path: Path) -> None:
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 8000, 0, "NONE", ""))
        file.writeframes(bytes(16_000))


@pytest.fixture
def outside(tmp_path_factory):
    """A folder with a shot, its model with a material, and its sound."""
    folder = tmp_path_factory.mktemp("outside")
    (folder / "parts").mkdir()
    model = folder / "parts/ball.obj"
    vertices = "".join(f"v {x} {y} {z}\n" for x, y, z in icosphere(3).vertices.tolist())
    faces = "".join(f"f {a} {b} {c}\n" for a, b, c in (icosphere(3).faces + 1).tolist())
    model.write_text(f"mtllib b.mtl\nusemtl red\n{vertices}{faces}")
    (folder / "parts/b.mtl").write_text("newmtl red\nKd 1 0 0\n")
    write_sound(folder / "tone.wav")
    text = SHOT.format(model="parts/ball.obj", sound="tone.wav")
    painted = text.replace("fit: 2}\nresample", "fit: 2, paint: on}\nlook: model\nresample")
    (folder / "b.yaml").write_text(painted)
    return folder


def test_files_of_the_project_are_named_from_shots(project):
    shots, bred = project.path / "shots", project.path / "bred/a"
    bred.mkdir(parents=True)
    (shots / "models").mkdir()
    write_ply(icosphere(3), shots / "models/ball.ply")
    write_sound(shots / "tone.wav")
    text = SHOT.format(model="../../shots/models/ball.ply", sound="../../shots/tone.wav")
    (bred / "a_01.yaml").write_text(text)
    done = project.call("--json", "new", "A020_new", "--from", "bred/a/a_01.yaml")
    assert done.code == 0 and json.loads(done.out)["files"] == ["shots/A020_new.yaml"], done.err
    _, _, copy = (shots / "A020_new.yaml").read_text().partition("title: ")
    expected = SHOT.format(model="models/ball.ply", sound="tone.wav").replace('"', "")
    assert copy.splitlines() == ["A020 new", *expected.splitlines()[1:]]


def test_files_outside_of_the_project_are_taken_along(project, outside):
    words = ("new", "A030_new", "--from", str(outside / "b.yaml"))
    files = ["shots/A030_new.yaml", "shots/parts/b.mtl", "shots/parts/ball.obj", "shots/tone.wav"]
    told = project.call("--json", "--dry-run", *words)
    assert told.code == 0 and sorted(json.loads(told.out)["files"]) == files, told.err
    assert not (project.path / "shots/tone.wav").exists()
    assert project.call(*words).code == 0
    assert {path.name for path, _ in read_shot(project.path / files[0]).files} == {
        Path(file).name for file in files[1:]
    }
    again = project.call("--json", "new", "A040_new", "--from", str(outside / "b.yaml"))
    assert json.loads(again.out)["files"] == ["shots/A040_new.yaml"], "the same files are there already"


def test_a_file_of_other_contents_is_not_replaced(project, outside):
    write_sound(project.path / "shots/tone.wav")
    with (project.path / "shots/tone.wav").open("ab") as file:
        file.write(b"\0\0")
    done = project.call("new", "A030_new", "--from", str(outside / "b.yaml"))
    assert done.code == 2 and "shots/tone.wav is there already with other contents" in done.err
    assert not (project.path / "shots/A030_new.yaml").exists()


BASE = """\
# what all have
frames: 1-4
subject: {solid: box, size: [1, 1, 1]}
resample: {max_edge_length: 0.5}
camera: {azimuth: 20, focal_length: 60}
look: ink
lights: bright
"""

TOP = """\
title: Top
extends: base
# Closer than the base.
camera: {elevation: 7}
# Its flow.
flows: [{twist: {amount: 2}}] # degrees"""

DEFAULTS = """\
rate: 30
looks: {ink: {material: glaze, colour: [0.1, 0.2, 0.5]}}
rigs: {bright: {rig: studio, exposure: 1, softboxes: [{name: k, position: [1, 4, 2], radiance: 9}]}}
"""


def test_a_copy_has_what_its_shot_inherits_in_its_own_folder(project, tmp_path_factory):
    folder = tmp_path_factory.mktemp("other show")
    for name, text in (("base", BASE), ("top", TOP), ("defaults", DEFAULTS)):
        (folder / f"{name}.yaml").write_text(text)
    done = project.call("new", "A030_new", "--from", str(folder / "top.yaml"))
    assert done.code == 0 and not done.err, done.err
    text = (project.path / "shots/A030_new.yaml").read_text()
    assert "# Closer than the base.\ncamera: {" in text
    assert "# Its flow.\nflows: [{twist: {amount: 2}}] # degrees\n" in text
    there, here = read_shot(folder / "top.yaml"), read_shot(project.path / "shots/A030_new.yaml")
    assert (here.motion, here.picture, here.rate) == (there.motion, there.picture, there.rate)


def test_a_model_whose_files_lie_elsewhere_is_not_copied_without_them(project, outside):
    (outside.parent / "materials").mkdir()
    (outside / "parts/b.mtl").rename(outside.parent / "materials/b.mtl")
    model = outside / "parts/ball.obj"
    model.write_text(model.read_text().replace("mtllib b.mtl", "mtllib ../../materials/b.mtl"))
    done = project.call("new", "A030_new", "--from", str(outside / "b.yaml"))
    assert done.code == 2 and "materials/b.mtl is named by another file, of another folder" in done.err
    assert not (project.path / "shots/A030_new.yaml").exists()
