"""A few models as they are found, each under one flow: validated, drawn, and standing on the floor.

`benchmarks.found_models` tries all of them, under four flows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import found_models
from benchmarks.found_models import verdict
from benchmarks.sample_models import MODELS, UNUSABLE
from flowsculpt.pipeline.errors import MeshError
from flowsculpt.pipeline.plugins.preview import animatic
from flowsculpt.pipeline.shot import read_shot

SHOT = """title: A model
frames: 1-4
subject: {{model: {file}, fit: 2}}
resample: {{max_edge_length: 0.16}}
flows: [{{{flow}}}]
look: clay
"""

FLOWS = {
    "twist": "twist: {axis: y, amount: {keys: {1: 0, 4: 40}}}",
    "vortex": "vortex: {axis: y, strength: 4}",
    "lorenz": "lorenz: {}",
    "curl_noise": "curl_noise: {octaves: 1}",
}

CHOSEN = {
    "pinched": "twist",
    "third face": "curl_noise",
    "open shell": "vortex",
    "five parts": "lorenz",
    "z up": "twist",
    "1e-3 units": "vortex",
    "1e5 off": "twist",
    "binary STL": "lorenz",
    "GLB": "curl_noise",
    "flipped faces": "vortex",
}


def shot_of(folder: Path, model: str, flow: str) -> Path:
    (folder / "shots").mkdir()
    file = MODELS[model](folder / "shots")
    path = folder / "shots" / "model.yaml"
    path.write_text(SHOT.format(file=file.name, flow=FLOWS[flow]))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("model", "flow"), CHOSEN.items())
def test_a_model_as_it_is_found_is_good_is_drawn_and_stands_on_the_floor(
    model: str, flow: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames

    monkeypatch.setitem(animatic.SIZES, "still", (96, 54))
    monkeypatch.setattr(found_models, "FRAME", 4)
    path = shot_of(tmp_path, model, flow)
    assert verdict(path, FirstFrames()) == ("good", [])
    facts = found_models.preview(tmp_path, path, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 1000
    assert abs(facts["floor"]) < 0.02, "it hovers, or is sunk into the floor"


@pytest.mark.parametrize("model", UNUSABLE)
def test_a_model_without_a_surface_is_refused_before_anything_is_drawn(model: str, tmp_path: Path) -> None:
    from flowsculpt.pipeline.plugins.authoring.first_frame import FirstFrames

    path = shot_of(tmp_path, model, "twist")
    kind, told = verdict(path, FirstFrames())
    assert kind == "error" and told
    with pytest.raises(MeshError):
        read_shot(path).motion.mesh_at_rest()


def test_the_models_of_the_trial_are_as_they_are_called(tmp_path: Path) -> None:
    shot = read_shot(shot_of(tmp_path, "z up", "twist"), settings=["subject.up=z"])
    vertices = shot.motion.mesh_at_rest().vertices
    assert np.ptp(vertices, axis=0).argmax() == 1
