"""Layers for compositing: channel names, mattes, and the attributes of the EXR."""

import json
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flowsculpt.render.post import compositing
from flowsculpt.render.post.compositing import (
    LayerInputs,
    Viewpoint,
    compositing_layers,
    mattes_header,
    unmixed,
)
from flowsculpt.render.post.exr_names import ExrAttributes
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.render_camera import Camera
from flowsculpt.render.scene.render_quality import CONVENTIONS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from tests.render.mattes import matte_of

CAMERA = Camera((1.0, 2.0, 8.0), (0.0, 1.0, 0.0))
SIZE = 16, 9
rng = np.random.default_rng(5)


def raw_frame(matte, stage=None):
    """Return raw AOVs of a subject at z = 0, alone or before a stage that covers the rest at z = -10."""
    height, width = matte.shape
    alpha = np.ones_like(matte) if stage else matte
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(1, -1, height))
    depths = np.stack([matte * 0.0, (alpha - matte) * -10.0])
    position = np.stack([x * alpha, y * alpha, depths.sum(axis=0)], axis=2)
    distance = matte * 8.0 + (alpha - matte) * 18.0
    offset = np.stack([matte * 0.25, matte * 0.0, matte * 0.0], axis=2)
    arrays = {"beauty": rng.random((height, width, 3)) * alpha[..., None], "alpha": alpha, "matte": matte}
    arrays |= {"position": position, "depth": distance, "after": offset, "before": -offset}
    arrays |= {name: rng.random((height, width, 3)) for name in ("normal", "albedo")}
    arrays["coverage.subject"] = matte
    if stage:
        arrays["coverage.stage"] = alpha - matte
    return RenderedFrame({name: array.astype(np.float32) for name, array in arrays.items()})


def shown(stage=False, camera=CAMERA):
    here, there = Viewpoint(CAMERA, StagePlacement()), Viewpoint(camera, StagePlacement())
    return LayerInputs(here, here, there, SIZE, STAGES["cyclorama" if stage else "none"], {"subject": "clay"})


def half_covered():
    matte = np.zeros((9, 16))
    matte[2:7, 4:10] = 1.0
    matte[2:7, 10] = 0.375
    return matte


@pytest.mark.parametrize(
    "name, digest",
    [
        ("hello", 0x248BFA47),
        ("hello, world", 0x149BBB7F),
        ("", 0),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_names_are_hashed_by_murmur_3(name, digest):
    assert compositing.murmur_hash(name) == digest


@given(st.text(max_size=40))
def test_the_id_of_any_name_is_a_normal_float(name):
    value = float(np.uint32(compositing.id_bits(name)).view(np.float32))
    assert math.isfinite(value) and abs(value) >= np.finfo(np.float32).tiny


@given(st.lists(st.integers(0, 64), min_size=1, max_size=5))
def test_mattes_give_every_coverage_back(parts):
    whole = max(64, sum(parts))
    coverage = {f"object {i}": np.full((1, 1), part / whole, np.float32) for i, part in enumerate(parts)}
    layers = compositing.cryptomatte_layers(compositing.OBJECT, coverage)
    ranks = np.concatenate([layer[0, 0, 1::2] for layer in layers.values()])
    assert (np.diff(ranks) <= 0.0).all(), "greatest coverage first"
    for name, plane in coverage.items():
        assert matte_of(name, compositing.OBJECT, layers) == plane


@pytest.mark.parametrize(
    "convention, names",
    [
        ("blender", "Combined.R Combined.A Depth.Z Vector.X Vector.W Normal.X Position.Z CryptoObject00.r"),
        ("arnold", "R A Z N.X P.Z motionvector.X crypto_object00.R crypto_material00.A"),
        ("nuke", "R A depth.Z forward.u forward.v backward.u normal.X CryptoObject00.red"),
    ],
)
def test_a_file_has_the_channel_names_of_its_program_and_is_read_back(tmp_path, convention, names):
    frame = raw_frame(half_covered(), stage=True)
    layers = RenderedFrame(compositing_layers(frame, shown(stage=True)))
    standard = mattes_header(frame, shown(stage=True), convention)
    write_exr(tmp_path / "a.exr", layers, {"frame": 1}, standard=standard, convention=convention)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    prefix = "ViewLayer." if convention == "blender" else ""
    assert {prefix + name for name in names.split()} <= set(spec.channelnames)
    labels = {spec.getattribute(name) for name in standard if name.endswith("/name")}
    for label in labels:
        assert any(name.startswith(f"{label}00.") for name in spec.channelnames)
        key = f"cryptomatte/{compositing.murmur_hash(label):08x}"[:19]
        manifest = json.loads(spec.getattribute(f"{key}/manifest"))
        matte = "subject" if label.lower().endswith("object") else "clay"
        assert manifest.keys() == {matte, "stage"}
    back, header = read_exr(tmp_path / "a.exr")
    assert header == {"frame": 1} and back.arrays.keys() == layers.arrays.keys()
    for name, array in layers.arrays.items():
        assert np.allclose(back[name], array, rtol=1e-3, atol=1e-4), name
    for name in ("planar_depth", "motion", "CryptoObject00"):
        assert np.array_equal(back[name], layers[name]), "float channels lose nothing"


def test_each_program_finds_other_names():
    assert set(CONVENTIONS) == {"blender", "arnold", "nuke"}


def test_depth_at_an_outline_is_of_the_subject_or_of_the_stage_and_not_between():
    layers = compositing_layers(raw_frame(half_covered(), stage=True), shown(stage=True))
    assert set(np.round(layers["depth"].ravel(), 4)) == {8.0, 18.0}
    assert set(np.round(layers["position"][..., 2].ravel(), 4)) == {0.0, -10.0}
    inside = np.abs(layers["motion"][..., 0]) > 0.0
    assert inside[2:7, 4:10].all() and not inside[2:7, 10].any(), "the stage covers more there"


def test_depth_of_a_cut_out_subject_is_that_of_the_subject_to_its_edge():
    layers = compositing_layers(raw_frame(half_covered()), shown())
    covered = half_covered() > 0.0
    assert np.allclose(layers["depth"][covered], 8.0)
    assert (layers["planar_depth"][~covered] == 1e10).all() and (layers["motion"][~covered] == 0.0).all()


def test_planar_depth_is_measured_along_the_view_direction():
    layers = compositing_layers(raw_frame(np.ones((9, 16))), shown())
    expected = (layers["position"] - np.array(CAMERA.origin)) @ CAMERA.axes()[2]
    assert np.allclose(layers["planar_depth"], expected, atol=1e-5)


def test_motion_vectors_follow_camera_and_subject():
    moved = replace(CAMERA, origin=(1.5, 2.0, 8.0), target=(0.5, 1.0, 0.0))
    frame = raw_frame(np.ones((9, 16)))
    layers = compositing_layers(frame, shown(camera=moved))
    points = frame["position"].reshape(-1, 3)
    scale, step = np.array(SIZE) / 2.0, np.array([0.25, 0.0, 0.0])
    start = CAMERA.project(points, 16 / 9)[:, :2] * scale
    after = moved.project(points + step, 16 / 9)[:, :2] * scale
    before = CAMERA.project(points - step, 16 / 9)[:, :2] * scale
    assert np.allclose(layers["motion"].reshape(-1, 2), after - start, atol=1e-4)
    assert np.allclose(layers["backward_motion"].reshape(-1, 2), before - start, atol=1e-4)


@given(st.integers(0, 2**32 - 1))
def test_pixels_of_one_thing_keep_their_values(seed):
    numbers = np.random.default_rng(seed)
    matte = (numbers.random((5, 6)) < 0.5).astype(np.float32)
    values = numbers.random((5, 6, 2)).astype(np.float32)
    assert np.array_equal(unmixed(values, matte, np.ones_like(matte), True), values)


def test_the_header_says_where_the_camera_stands_and_when_the_frame_is_shown(tmp_path):
    attributes = ExrAttributes((16, 9), (4, 2), CAMERA, Fraction(24000, 1001), "01:02:03:21")
    layers = RenderedFrame({"beauty": np.zeros((5, 8, 3), np.float32)})
    write_exr(tmp_path / "a.exr", layers, {}, attributes=attributes)
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert (spec.x, spec.y, spec.width, spec.height) == (4, 2, 8, 5), "the data window is the crop"
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 16, 9)
    assert read_exr(tmp_path / "a.exr")[0].size == (8, 5)
    assert spec.getattribute("framesPerSecond") == (24000, 1001)
    assert spec.getattribute("smpte:TimeCode")[0] == 0x01020321
    assert len(spec.getattribute("chromaticities")) == 8 and spec.getattribute("colorInteropID")
    points = np.array([[0.3, 0.7, 0.2, 1.0], [-1.0, 2.0, -3.0, 1.0]])
    x, y, depth = CAMERA.project(points[:, :3], 16 / 9).T
    to_camera = np.array(spec.getattribute("worldToCamera")).reshape(4, 4)
    assert np.allclose((points @ to_camera)[:, 2], depth, atol=1e-5), "row vectors; z is depth"
    screen = points @ np.array(spec.getattribute("worldToNDC")).reshape(4, 4)
    ndc = screen[:, :2] / screen[:, 3:]
    assert np.allclose(ndc, np.stack([(x + 1) / 2, (1 - y) / 2], axis=1), atol=1e-5)


def test_a_rate_beyond_timecode_leaves_it_out(tmp_path):
    attributes = ExrAttributes(rate=Fraction(60), timecode="00:00:00:48")
    write_exr(
        tmp_path / "a.exr",
        RenderedFrame({"beauty": np.zeros((1, 1, 3), np.float32)}),
        {},
        attributes=attributes,
    )
    spec = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec()
    assert spec.getattribute("smpte:TimeCode") is None
