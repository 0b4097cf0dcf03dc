"""JSON Schemas accept what the reader accepts, and refuse the mistakes that a schema can see."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from flowsculpt.pipeline.errors import ShotError
from flowsculpt.pipeline.plugins.authoring.shot_schemas import defaults_schema, film_schema, shot_schema
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents.flow_documents import FLOW_DOCUMENTS
from flowsculpt.pipeline.shot.yaml.yaml_source import YamlSource
from tests.conftest import new_project
from tests.needed_plugins import gallery_rows, needed_in, needs_plugins

COMMAND = [sys.executable, "-m", "flowsculpt", "--no-progress"]

HOME = Path(__file__).parents[3]
SHOTS = sorted(path for path in (HOME / "shots").glob("*.yaml"))
FILMS = {path for path in SHOTS if "shots" in YamlSource.read(path).data}

HEAD = {"title": "Page", "frames": "1-96", "subject": {"solid": "box"}, "resample": "off"}


@cache
def checker(kind: str = "shot") -> Any:
    schema = {"shot": shot_schema, "film": film_schema, "defaults": defaults_schema}[kind]()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def as_json(value: Any) -> Any:
    """Return a YAML value as an editor sees it: names are text."""
    if isinstance(value, dict):
        return {str(name): as_json(inner) for name, inner in value.items()}
    return [as_json(inner) for inner in value] if isinstance(value, list) else value


def data_of(text: str) -> Any:
    return as_json(YamlSource.read(Path("a.yaml"), text).data)


def accepts(text: str, kind: str = "shot") -> bool:
    return bool(checker(kind).is_valid(data_of(text)))


@pytest.mark.slow
@pytest.mark.parametrize("path", gallery_rows(SHOTS))
def test_every_file_of_shots_is_valid(path: Path) -> None:
    kind = "film" if path in FILMS else "defaults" if path.stem == "defaults" else "shot"
    checker(kind).validate(as_json(YamlSource.read(path).data))


def _examples() -> list[Any]:
    found = []
    for page in (*sorted((HOME / "docs").glob("*.md")), HOME / "README.md"):
        for i, text in enumerate(re.findall(r"```yaml\n(.*?)```", page.read_text("utf-8"), re.DOTALL)):
            if not re.match("# profiles/|(?s:.*)(marbling|ripples)", text):  # plug-ins' are checked with them
                found.append(pytest.param(text, marks=needs_plugins(*needed_in(text)), id=f"{page.stem}-{i}"))
    return found


@pytest.mark.parametrize("text", _examples())
def test_every_example_of_the_docs_is_valid(text: str) -> None:
    """Some are whole files, some names of a shot, some entries of flows, some settings of resampling."""
    if "max_edge_length" in text and text.count("max_edge_length") > 1 and "title" not in text:
        parts = [{"resample": data_of(line)} for line in text.splitlines()]
    elif text.startswith("- "):
        parts = [{"flows": data_of(text)}]
    elif text.startswith("strength"):
        parts = [{"flows": [{"vortex": data_of(line)}]} for line in text.splitlines()]
    else:
        parts = [data_of(text)]
    for part in parts:
        kind = "film" if "shots" in part else "shot"
        head = {name: value for name, value in HEAD.items() if name != "subject" or "subjects" not in part}
        checker(kind).validate({**({} if kind == "film" else head), **part})


GOOD = """\
title: Cube
frames: 1-49
rate: 24
subject: {solid: box}
resample: {max_edge_length: 0.25}
flows:
  - sum:
      - vortex: {axis: z, centre: [0.9, 0, 0], radius: 0.8, strength: {keys: {1: 0, 25: 4}}}
      - rotation: {speed: 90}
  - twist: {amount: {ease: linear, keys: {1: 0, "2s": 60}}}
camera: {azimuth: {keys: {1: -30, 49: 30}}}
"""

SAME = [
    ("frames: 1-49", "frames: 1-24,25-49"),
    ("rate: 24", "rate: 24000/1001"),
    ("rate: 24", "rate: 23.976"),
    ("solid: box", "solid: box, size: [1, 2, 3]"),
    ("solid: box", "solid: rod, caps: flat, length: 2"),
    ("{max_edge_length: 0.25}", "off"),
    ("max_edge_length: 0.25", "max_edge_length: {keys: {1: 0.25, 2s: 0.2}, ease: linear}"),
    ("max_edge_length: 0.25", "max_edge_length: {formula: 0.2 + 0.01 * abs(x)}, creases: {formula: x > 0}"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, min_edge_length: 0, creases: none"),
    ("25: 4", "25: {value: 4, ease: bounce_out}"),
    ("25: 4", "25: {value: 4, ease: settle 0.3}"),
    ("25: 4", "25: {value: 4, right: [6, 0.5]}, 49: {value: 0, left: [-0.5s, 1]}"),
    ("1: 0, 25: 4", "1: 0, .5: 1, 12.5: 2, 0.75s: 3, 49: 4".replace(".5: 1, ", "")),
    ("{keys: {1: 0, 25: 4}}", "{formula: 4 * sin(t)}"),
    ("{keys: {1: 0, 25: 4}}", "{formula: 4}"),
    ("[0.9, 0, 0]", "{formula: [cos(t), '0', 0]}"),
    ("axis: z", "axis: [1, 0, 1]"),
    (
        "subject: {solid: box}\nresample: {max_edge_length: 0.25}",
        "subject: {cloud: {solid: box}, radius: 0.1}",
    ),
    ("camera:", "look: {material: clay, pigment: {marble: {colours: [[1, 1, 1], [0, 0, 0]]}}}\ncamera:"),
    ("- rotation: {speed: 90}", "- lorenz:"),
    ("- rotation: {speed: 90}", "- lorenz: {}"),
    ("- rotation: {speed: 90}", "- formula: [-y, x, 0]"),
    ("- rotation: {speed: 90}", "- formula: {velocity: [-k*y, x, 0], with: {k: {keys: {1: 0, 9: 1}}}}"),
    ("- rotation: {speed: 90}", "- attraction: {curve: [[0, 0, 0], [1, 1, 0]], closed: true}"),
    ("- rotation: {speed: 90}", "- within: {region: {sphere: {radius: 1}, falloff: 1}, flows: [{abc: }]}"),
    ("  - twist", "  - repeated: {period: 12, flows: [{shear: {amount: 1}}]}\n  - twist"),
    ("  - twist", "  - repeated: {period: 0.5s, flows: [{shear: {amount: 1}}]}\n  - twist"),
    ("  - twist", "  - reversed: {flows: [{shear: {amount: 1}}]}\n  - twist"),
    ("camera:", "substeps:\ncamera:"),
    ("camera:", "speed: {keys: {1: 1, 49: -1}}\ncamera:"),
    ("camera:", "look: {material: glaze, roughness: 0.2}\nlights: {exposure: 1}\ncamera:"),
    ("camera:", "quality: {final: {samples: 96, denoise: off}, draft: {samples: 6}}\ncamera:"),
    ("camera:", "quality: {final: {noise_threshold: 0.02}}\ncamera:"),
    ("camera:", "quality: {final: {noise_threshold: off}}\ncamera:"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("good", "other"), SAME, ids=[other for _, other in SAME])
def test_all_that_the_reader_takes_is_valid(good: str, other: str) -> None:
    assert good in GOOD
    text = GOOD.replace(good, other)
    assert read_shot("a.yaml", text).title == "Cube"
    checker().validate(data_of(text))


BROKEN = [
    ("axis: z, cen", "axiz: z, cen"),
    ("- vortex", "- vortx"),
    ("solid: box", "solid: bax"),
    ("linear", "lineal"),
    ("radius: 0.8", "radius: wide"),
    ("radius: 0.8", "radius: -1"),
    ("radius: 0.8", "radius: true"),
    ("radius: 0.8", "radius: [1, 2]"),
    ("radius: 0.8", "radius: {keys: {1: 0.5, 9: 0}}"),
    ("radius: 0.8", "radius: {keys: {}}"),
    ("radius: 0.8", "radius: {ease: linear}"),
    ("radius: 0.8", "radius: {formula: '1', ease: linear}"),
    ("[0.9, 0, 0]", "[0.9, 0]"),
    ("[0.9, 0, 0]", "[0.9, 0, 2e12]"),
    ("[0.9, 0, 0]", "{formula: cos(t)}"),
    ("25: 4", "soon: 4"),
    ("25: 4", "25: {value: 4, left: 3}"),
    ("25: 4", "25: 1e308"),
    ("25: 4", "25: [1, 2, 3]"),
    ("1-49", "1-49x2"),
    ("1-49", "all"),
    ("frames: 1-49", "frames: 49"),
    ("rate: 24", "rate: fast"),
    ("rate: 24", "rate: [24]"),
    ("rate: 24", "rate: 1e-320"),
    ("title: Cube\n", ""),
    ("subject: {solid: box}\n", ""),
    ("resample: {max_edge_length: 0.25}\n", ""),
    ("solid: box", "size: [1, 1, 1]"),
    ("solid: box", "solid: box, radius: 1"),
    ("solid: box", "solid: box, size: [1, 2]"),
    ("solid: box", "solid: box, model: a.obj"),
    ("axis: z", "axis: [0, 0, 0]"),
    ("axis: z", "axis: w"),
    ("- rotation: {speed: 90}", "- {rotation: {speed: 90}, lorenz: }"),
    ("- rotation: {speed: 90}", "- {}"),
    ("- rotation: {speed: 90}", "- rotation:"),
    ("- rotation: {speed: 90}", "- rotation: {}"),
    ("- rotation: {speed: 90}", "- twist: {amount: 2}"),
    ("- rotation: {speed: 90}", "- repeated: {period: 1, flows: [{abc: }]}"),
    ("- rotation: {speed: 90}", "- formula: [-y, x]"),
    ("- rotation: {speed: 90}", "- attraction: {rate: 1}"),
    ("- rotation: {speed: 90}", "- within: {region: {falloff: 1}, flows: [{abc: }]}"),
    ("- rotation: {speed: 90}",
     "- within: {region: {sphere: {radius: 1}, box: {size: [1, 1, 1]}}, flows: [{abc: }]}"),
    ("- rotation: {speed: 90}", "- within: {region: {sphere: {radius: 1}}, flows: []}"),
    ("- rotation: {speed: 90}", "- vortex_pair: {turning: both}"),
    ("- rotation: {speed: 90}", "- blend: {weight: 1.5, flows: [{abc: }]}"),
    ("  - twist", "  - repeated: {period: 0, flows: [{shear: {amount: 1}}]}\n  - twist"),
    ("  - twist", "  - repeated: {period: soon, flows: [{shear: {amount: 1}}]}\n  - twist"),
    ("  - twist", "  - sum:\n  - twist"),
    ("{max_edge_length: 0.25}", "no"),
    ("{max_edge_length: 0.25}", "{}"),
    ("max_edge_length: 0.25", "max_edge_length: {}"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, placement: exct"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, rest_interval: 0"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, crease: rest"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, hard_angle: 180"),
    ("max_edge_length: 0.25", "max_edge_length: {formula: '1', camera: {}}"),
    ("camera:", "substeps: 0\ncamera:"),
    ("camera:", "substeps: 1.5\ncamera:"),
    ("camera:", "look: [clay]\ncamera:"),
    ("camera:", "look: {roughness: 0.2}\ncamera:"),
    ("camera:", "quality: {draught: {samples: 6}}\ncamera:"),
    ("camera:", "quality: {final: {samples: 100}}\ncamera:"),
    ("camera:", "quality: {final: {noise_threshold: 0}}\ncamera:"),
    ("camera:", "quality: {final: {noise_threshold: none}}\ncamera:"),
    ("camera:", "camera: {margin: 0.5}\n#"),
    ("camera:", "titlex: x\ncamera:"),
]  # fmt: skip


@pytest.mark.parametrize(("good", "bad"), BROKEN, ids=[bad for _, bad in BROKEN])
def test_a_mistake_that_a_schema_can_see_is_refused_by_reader_and_schema(good: str, bad: str) -> None:
    assert good in GOOD and accepts(GOOD)
    text = GOOD.replace(good, bad)
    with pytest.raises(ShotError):
        read_shot("a.yaml", text)
    assert not accepts(text)


@pytest.mark.slow
def test_a_shot_that_extends_another_need_say_no_more_and_nor_need_defaults() -> None:
    rest = "extends: A\nsubject: {radius: 2}\nresample: {hard_angle: 30}\nlook: {roughness: 0.1}\n"
    assert accepts(rest) and not accepts(rest.replace("extends: A\n", ""))
    assert not accepts(rest + "flows: [{rotation: {}}]\n"), "lists are replaced, so their items are whole"
    assert accepts("look: glaze\nresample: {min_roundness: 0.7}\n", "defaults")
    assert not accepts("look: {material: clay, roughnes: 0.1}\n", "defaults")
    beside = jsonschema.Draft202012Validator(shot_schema({"resample": {}, "look": "clay"}))
    assert beside.is_valid(data_of("title: A\nframes: 1-2\nsubject: {solid: box}\nlook: {roughness: 1}\n"))
    assert not beside.is_valid({"title": "A", "frames": "1-2"})


def test_editors_propose_the_looks_and_rigs_of_the_show_and_allow_those_of_a_shot() -> None:
    schema = shot_schema({"looks": {"ink": "glaze"}, "rigs": {"duotone": "studio"}})
    proposed = re.findall(r'"enum": \[([^]]*)\]', json.dumps(schema))
    assert any('"chrome"' in names and '"ink"' in names for names in proposed)
    assert any('"daylight"' in names and '"duotone"' in names for names in proposed)
    own = "looks: {velvet: {material: putty, sheen: 1}}\nrigs: {dusk: daylight}\nlook: velvet\nlights: dusk\n"
    assert accepts(GOOD + own)


def test_a_film_has_a_schema_of_its_own() -> None:
    film = "title: Two\nshots: [A, B]\nrate: 24\n"
    assert accepts(film, "film")
    for bad in ("shots: []\ntitle: x\n", film + "title_seconds: 90\n", film + "subtitel: x\n"):
        assert not accepts(bad, "film")


@pytest.mark.parametrize("schema", [shot_schema(), film_schema(), defaults_schema()])
def test_editors_understand_every_bound(schema: Any) -> None:
    """Bounds stand under the keywords of JSON Schema, none under a name of pydantic's."""
    assert re.findall(r'"(?:ge|gt|le|lt)": [\d.-]+', json.dumps(schema)) == []


def test_every_name_is_explained() -> None:
    for schema in (shot_schema(), film_schema(), defaults_schema()):
        documents = {"": schema, **schema.get("$defs", {})}
        for name, document in documents.items():
            for form in document.get("anyOf", [document]):
                for field, value in form.get("properties", {}).items():
                    assert value.get("description"), f"hints.py has no word for {field} of {name}"


def test_units_and_defaults_of_flows_are_those_of_the_code() -> None:
    schema = shot_schema()
    entries = schema["$defs"]["Flow"]["properties"]
    assert set(FLOW_DOCUMENTS) <= set(entries)
    strength = schema["$defs"]["Vortex"]["properties"]["strength"]
    assert "units²/s" in strength["description"] and strength["default"] == 1.0
    assert entries["vortex"]["description"].startswith("Turns about a line")
    assert "title" not in strength and "Document" not in str(schema)


@pytest.fixture(scope="module")
def show(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return new_project(tmp_path_factory.mktemp("show")).path


@pytest.mark.slow
def test_a_reader_that_leaves_ends_the_command_without_a_word(show: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([*COMMAND, "schema"], cwd=show, stdout=write, stderr=subprocess.PIPE, timeout=300)
    os.close(write)
    assert done.stderr == b"" and done.returncode == 141


@pytest.mark.slow
def test_a_pipe_that_does_not_block_gets_everything(show: Path) -> None:
    read, write = os.pipe()
    os.set_blocking(write, False)
    with subprocess.Popen([*COMMAND, "schema"], cwd=show, stdout=write) as process:
        os.close(write)
        with os.fdopen(read, "rb") as reader:
            schema = reader.read()
    assert process.returncode == 0
    assert len(schema) > 1 << 16, "a pipe holds less, or the test shows nothing"
    assert json.loads(schema)["title"]
