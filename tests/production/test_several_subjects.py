"""Shots of several subjects in production: chains of their own, one picture of all, and files for each."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.pipeline.animation import MeshFrame
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning.frame_states import FrameStates
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.render.post.compositing import ASSET, OBJECT
from flowsculpt.render.post.image import read_exr, read_header
from tests.conftest import commanded, done
from tests.needed_plugins import needs_plugins
from tests.render.mattes import matte_of

NAME, QUALITY = "T010_two", "draft.scale6.7"
SHOT = """\
title: Two
frames: 1-3
subjects:
  crane: {solid: box, size: [0.6, 0.6, 0.6], place: [-0.8, 0, 0], look: glaze}
  heron: {solid: icosphere, radius: 0.4, place: [0.8, 0, 0], look: chrome}
resample: {max_edge_length: 0.5}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 3: 40}}}
shutter: {angle: 180}
layers: nuke
quality: {draft: {samples: 2, auxiliary_samples: 1, denoise: fast, temporal_denoise: 0}}
"""


def planned(root: Path, text: str = SHOT) -> Plan:
    (root / "shots").mkdir(exist_ok=True)
    (root / "shots" / f"{NAME}.yaml").write_text(text)
    return Project(root, 2).pictures([str(root / "shots" / f"{NAME}.yaml")], QUALITY)


def request_of(root: Path) -> RenderRequest:
    return Project(root, 2).request(root / "shots" / f"{NAME}.yaml", QUALITY)


def test_each_subject_is_simulated_by_a_job_of_its_own_and_pictures_wait_for_all(tmp_path: Path) -> None:
    plan = planned(tmp_path)
    thawed = Plan.thaw(tmp_path / plan.freeze(tmp_path))
    by_output = {job.output: job for job in thawed.jobs}
    stages = sorted(job.stage for job in thawed.jobs)
    assert stages == [
        "assemble",
        "finish",
        "frame_camera",
        "render",
        *["simulate"] * 2,
        *["smooth_normals"] * 2,
    ]
    subject = {job.name: thawed.requests[job.requests[0]].source.subject for job in thawed.jobs}
    for job in thawed.jobs:
        read = [by_output[output] for output in thawed.all_inputs(job)]
        found = sorted((each.stage, subject[each.name]) for each in read)
        if job.stage == "smooth_normals":
            assert found == [("simulate", subject[job.name])]
        if job.stage == "frame_camera":
            assert found == [("simulate", "crane"), ("simulate", "heron")]


def test_an_edit_of_one_subject_leaves_the_keys_and_files_of_the_others_alone(tmp_path: Path) -> None:
    planned(tmp_path)
    before = request_of(tmp_path)
    planned(tmp_path, SHOT.replace("radius: 0.4", "radius: 0.3"))
    after = request_of(tmp_path)
    crane, heron = zip(before.parts, after.parts, strict=True)
    assert crane[0].keys.mesh(3) == crane[1].keys.mesh(3) and crane[0].keys.normals(3) == crane[
        1
    ].keys.normals(3)
    assert heron[0].keys.mesh(1) != heron[1].keys.mesh(1)
    assert before.keys.cameras != after.keys.cameras and before.keys.normals(1) != after.keys.normals(1)
    planned(tmp_path, SHOT.replace("look: chrome", "look: glass"))
    relit = request_of(tmp_path)
    assert relit.keys.cameras == before.keys.cameras and relit.keys.normals(2) == before.keys.normals(2)
    assert relit.keys.appearance(1) != before.keys.appearance(1)
    planned(tmp_path, SHOT.replace("heron:", "stork:"))
    assert request_of(tmp_path).keys.normals(1) != before.keys.normals(1), "pictures show the names in mattes"


def test_a_subject_of_a_shot_has_the_meshes_of_a_shot_with_that_subject_alone(tmp_path: Path) -> None:
    planned(tmp_path)
    crane = request_of(tmp_path).parts[0]
    entry = "subject: {solid: box, size: [0.6, 0.6, 0.6]}\n"
    first, last = SHOT.index("subjects:"), SHOT.index("resample:")
    planned(tmp_path, SHOT.replace(", place: [-0.8, 0, 0]", ""))
    alone = request_of(tmp_path).parts[0]
    planned(tmp_path, SHOT[:first] + entry + SHOT[last:])
    assert alone.keys.mesh(3) == request_of(tmp_path).keys.mesh(3) != crane.keys.mesh(3)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("several")
    done(root, planned(root))
    return root


def test_a_picture_shows_each_subject_with_its_look_and_mattes_tell_them_apart(made: Path) -> None:
    request = request_of(made)
    layers, header = read_exr(made / request.place("frame", 2))
    crypto = {name: layers[name] for name in layers.arrays if name.startswith(OBJECT)}
    crane, heron = (matte_of(name, OBJECT, crypto) for name in ("crane", "heron"))
    assert crane.max() > 0.9 and heron.max() > 0.9
    columns = np.arange(crane.shape[1])
    assert (crane.sum(axis=0) @ columns) / crane.sum() < (heron.sum(axis=0) @ columns) / heron.sum()
    assert float((crane + heron).sum()) == pytest.approx(float(layers["matte"].sum()), rel=0.15)
    assert {part["name"]: part["look"]["model"] for part in header["subjects"]} == {
        "crane": "plastic",
        "heron": "metal",
    }


BEADS = """\
  beads:
    solid: box
    size: [0.3, 0.3, 0.3]
    copies: {count: 3, seed: 4, region: {box: {size: [2, 0.8, 0.8], centre: [0, 1.2, 0]}}}
"""


def test_each_copy_has_a_matte_and_all_of_them_are_one_asset(tmp_path: Path) -> None:
    text = SHOT.replace("resample:", f"{BEADS}resample:", 1)
    text = text.replace("frames: 1-3", "frames: 1-2").replace("3: 40", "2: 40")
    done(tmp_path, planned(tmp_path, text))
    request = request_of(tmp_path)
    layers, _ = read_exr(tmp_path / request.place("frame", 2))
    names = ["beads.1", "beads.2", "beads.3"]
    opened = oiio.ImageInput.open(str(tmp_path / request.place("frame", 2)))
    assert opened is not None
    attributes = opened.spec().extra_attribs
    manifests = {each.name: str(each.value) for each in attributes if each.name.endswith("/manifest")}
    manifest = next(json.loads(text) for text in manifests.values() if "beads.1" in text)
    assert len(manifests) == 3  # objects, assets, materials
    assert set(names) < set(manifest) and "beads" not in manifest
    if request.variant == "scalar_rgb":
        return
    sets = {kind: {n: layers[n] for n in layers.arrays if n.startswith(kind)} for kind in (OBJECT, ASSET)}
    each = [matte_of(name, OBJECT, sets[OBJECT]) for name in names]
    assert all(matte.max() > 0.9 for matte in each)
    assert np.allclose(sum(each), matte_of("beads", ASSET, sets[ASSET]), atol=2e-3)
    assert matte_of("crane", ASSET, sets[ASSET]).max() == matte_of("crane", OBJECT, sets[OBJECT]).max()


def test_mattes_and_motion_vectors_of_rigid_copies_are_those_of_their_placements(tmp_path: Path) -> None:
    text = SHOT.replace("resample:", f"{BEADS}resample:", 1).replace("{count: 3,", "{count: 3, rigid: true,")
    text = text.replace("frames: 1-3", "frames: 1-2").replace("3: 40", "2: 40").replace("180}", "0}")
    done(tmp_path, planned(tmp_path, text))
    request = request_of(tmp_path)
    if request.variant == "scalar_rgb":
        return
    layers, _ = read_exr(tmp_path / request.place("frame", 1))
    crypto = {name: layers[name] for name in layers.arrays if name.startswith(OBJECT)}
    beads = next(part for part in request.parts if part.source.subject == "beads")
    now, after = (MeshFrame.from_arrays(np.load(tmp_path / beads.place("mesh", n)), n) for n in (1, 2))
    framing = request.pictures.framings(Project(tmp_path, 2).store)[1]
    height, width = layers["matte"].shape[:2]
    assert now.copies is not None and after.copies is not None
    here, there = (
        framing.camera.project(f.mesh.vertices, request.pictures.aspect)[:, :2].reshape(3, -1, 2)
        for f in (now, after)
    )
    for number, (seen, next_seen) in enumerate(zip(here, there, strict=True), 1):
        matte = matte_of(f"beads.{number}", OBJECT, crypto)
        rows, columns = np.nonzero(matte > 0.5)
        x, y = (seen * (0.5, -0.5) + 0.5).T * ((width,), (height,))
        assert x.min() - 1 <= columns.min() <= columns.max() <= x.max() + 1
        assert y.min() - 1 <= rows.min() <= rows.max() <= y.max() + 1
        moves = (next_seen - seen) * (0.5 * width, 0.5 * height)
        shown = layers["motion"][matte > 0.99]
        assert len(shown) > 3
        assert (shown > moves.min(axis=0) - 0.02).all() and (shown < moves.max(axis=0) + 0.02).all()


def test_only_pictures_that_tell_copies_apart_have_other_keys(tmp_path: Path) -> None:
    text = SHOT.replace("resample:", f"{BEADS}resample:", 1)
    planned(tmp_path, text)
    assert request_of(tmp_path).pictures.copies == {"beads": 3}
    planned(tmp_path, text.replace("layers: nuke\n", ""))
    assert request_of(tmp_path).pictures.copies == {}
    planned(tmp_path)
    assert request_of(tmp_path).pictures.copies == {}


def test_nothing_is_to_be_done_twice_and_one_edit_makes_one_chain_again(made: Path) -> None:
    assert planned(made).jobs == ()
    edited = planned(made, SHOT.replace("radius: 0.4", "radius: 0.3"))
    chains = [job for job in edited.jobs if job.stage in ("simulate", "smooth_normals")]
    assert {edited.requests[job.requests[0]].source.subject for job in chains} == {"heron"}
    states = FrameStates.of_meshes(request_of(made), Project(made, 2).store, History.of(made))
    assert list(states.stale) == [1, 2, 3]
    planned(made)
    assert list(FrameStates.of_meshes(request_of(made), Project(made, 2).store, History.of(made)).done) == [
        1,
        2,
        3,
    ]


def test_measures_of_several_subjects_are_those_of_all_taken_together(made: Path) -> None:
    from flowsculpt.pipeline.plugins.review.measures import measured

    request, store = request_of(made), Project(made, 2).store
    together = measured(request, store, [2], 1)[2]
    each = [measured(part, store, [2], 1)[2] for part in request.parts]
    for name in ("vertices", "faces", "area", "volume"):
        assert together[name] == pytest.approx(sum(part[name] for part in each))
    assert sum(together["quality"]) == pytest.approx(1.0, abs=1e-3)


@needs_plugins("authoring", "preview", "review")
def test_commands_work_on_each_subject_or_on_the_one_that_is_named(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made)
    code, said = commanded(made, "validate", NAME)
    assert code == 0 and "crane" in said and "heron" in said
    assert commanded(made, "figures", NAME)[0] == 0
    home = made / "renders" / NAME
    assert {page.name for page in home.glob("*.svg")} == {
        f"{NAME}.{s}.figures.svg" for s in ("crane", "heron")
    }
    code, said = commanded(made, "preview", NAME, "--at", "2")
    assert code == 0, said
    assert commanded(made, "figures", NAME, "--subject", "herron") == (
        UsageError.exit_code,
        f"{NAME} has no subject 'herron'. Did you mean 'heron'?",
    )


def test_the_turntable_of_several_subjects_turns_them_about_one_axis(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flowsculpt.pipeline.plugins.turntable.turntable_movie import TurntableRequest

    monkeypatch.chdir(made)
    turning = TurntableRequest(Project(made, 2), NAME, QUALITY, 2, 2, turn="object", bare=True)
    done(made, turning.plan())
    (request,) = turning.requests
    positions = []
    for number in (1, 2):
        raw, _ = read_exr(made / request.place("raw", number))
        crane = raw["coverage.crane"]
        positions.append((crane.sum(axis=0) @ np.arange(crane.shape[1])) / crane.sum() / crane.shape[1])
    assert positions[0] < 0.45 < 0.55 < positions[1], "half a turn exchanges their sides"
    assert json.dumps(read_header(made / request.place("raw", 1))["subjects"])
