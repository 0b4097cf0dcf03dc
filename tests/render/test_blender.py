"""Blender's compositor reads our layers. `make blender` installs Blender as a module."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from flowsculpt.render.frame.render_frame import render_frame
from flowsculpt.render.post.compositing import (
    MATERIAL,
    OBJECT,
    LayerInputs,
    Viewpoint,
    compositing_layers,
    mattes_header,
)
from flowsculpt.render.post.exr_names import cryptomatte_label
from flowsculpt.render.post.image import read_exr, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.materials import LOOKS
from flowsculpt.render.scene.render_quality import CONVENTIONS
from flowsculpt.render.scene.scene import Scene
from flowsculpt.render.scene.scene_lights import LIGHTS
from flowsculpt.render.scene.scene_stage import STAGES, StagePlacement
from tests.render.conftest import CAMERA, TINY

BLENDER = Path(os.environ.get("BLENDER_MODULE", Path(sys.prefix) / "cycles"))
BACKGROUND = (0.25, 0.5, 0.125)

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(not (BLENDER / "bpy").is_dir(), reason="Blender is not there: make blender"),
]


def composited(folder, frame, mattes):
    """Return what Blender makes of an EXR, channels (H, W) by name."""
    task = {"picture": str(frame), "size": TINY.rendered_size, "folder": str(folder), "mattes": mattes}
    script = Path(__file__).with_name("blender_compositor.py")
    command = [sys.executable, str(script), json.dumps({**task, "background": [*BACKGROUND, 1.0]})]
    environment = {**os.environ, "PYTHONPATH": str(BLENDER)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    file = oiio.ImageInput.open(str(folder / "composited.exr"))
    assert file is not None, done.stdout + done.stderr
    channels, part = {}, 0
    while file.seek_subimage(part, 0):  # Blender writes a part for each item
        spec = file.spec()
        pixels = file.read_image(part, 0, 0, spec.nchannels, oiio.FLOAT)
        channels |= {name: pixels[..., index] for index, name in enumerate(spec.channelnames)}
        part += 1
    return channels


@pytest.mark.parametrize("stage", ["none", "plinth"])
@pytest.mark.parametrize("convention", CONVENTIONS)
def test_blender_composites_our_layers_and_picks_our_mattes(convention, stage, sphere, engine, tmp_path):
    scene = Scene(sphere, LOOKS["clay"], LIGHTS["studio"], STAGES[stage], StagePlacement(), CAMERA)
    raw = render_frame(scene, TINY, 5, engine)
    step = raw["matte"][..., None] * np.float32([0.5, 0.25, 0.0])
    raw = RenderedFrame({**raw.arrays, "after": step, "before": -0.5 * step})
    view = Viewpoint(CAMERA, StagePlacement())
    shown = LayerInputs(view, view, view, TINY.rendered_size, STAGES[stage], {"subject": "clay"})
    layers = RenderedFrame(compositing_layers(raw, shown))
    standard = mattes_header(raw, shown, convention)
    write_exr(tmp_path / "frame.exr", layers, {}, standard=standard, convention=convention)
    ours = read_exr(tmp_path / "frame.exr")[0]

    objects = ["subject", *STAGES[stage].objects]
    mattes = [(cryptomatte_label(OBJECT, convention), name) for name in objects]
    theirs = composited(
        tmp_path, tmp_path / "frame.exr", [*mattes, (cryptomatte_label(MATERIAL, convention), "clay")]
    )

    over = ours["beauty"] + (1.0 - ours["alpha"])[..., None] * np.float32(BACKGROUND)
    for index, letter in enumerate("RGB"):
        assert np.array_equal(theirs[f"over.{letter}"], over[..., index])
    for number, name in enumerate([*objects, "subject"]):
        coverage = raw[f"coverage.{name}"] if engine.variant != "scalar_rgb" else raw["matte"]
        assert coverage.max() == 1.0 and np.array_equal(theirs[f"matte{number}.V"], coverage), name
    if convention == "blender":  # X and Y come from the frame before; Z and W go on from the next one
        assert np.allclose(theirs["vector.X"], ours["backward_motion"][..., 0])
        assert np.allclose(theirs["vector.Z"], -ours["motion"][..., 0])
    assert ours["motion"].max() > 0.5
