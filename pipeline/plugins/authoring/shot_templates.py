"""Templates of new shots: one for every flow that works at once and shows what may be changed.

`flow_presets.yaml` holds the subjects and values; files that a flow reads are written beside the shot.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flowsculpt import FlowsculptError
from flowsculpt.pipeline.plugins.authoring.reference import kept
from flowsculpt.pipeline.plugins.authoring.shot_schemas import default_text, facts, preset_names

if TYPE_CHECKING:
    from flowsculpt import PolygonMesh

SCHEMA = "# yaml-language-server: $schema={}\n"
"""Tells editors the schema of a file, relative to it."""

FRAMES = 72

STRENGTHS = ("time_scale", "strength", "speed", "rate", "amount", "flux")
"""Parameters that set the strength of a flow without a preset."""

COLUMN = 58
"""Column of comments after values, where these leave space."""

SHOT = """\
title: {title}
intent: What this shot should show, in one sentence.

frames: 1-{last}  # the first shows the subject at rest; the flow acts from the second on
rate: 24  # frames per second

{about_subject}
subject: {subject}

# Edges longer than this are split, those shorter than 40% of it collapse. Half the length: 4 × the faces.
{about_edges}resample: {{max_edge_length: {edge}}}

# Entries act one after another in each frame, those under `sum:` at once. Keys are frames, "0.5s" is seconds.
flows:
{flows}

# Looks: {looks}.
look: {look}  # or {{material: {coloured}, colour: [0.6, 0.5, 0.4]}}
set: {set}; a place with lights and a camera
# Degrees. The set turns along with azimuth; orbit: 20 moves the camera around a set that stands still.
camera: {{azimuth: {{keys: {{1: {left:g}, {last}: {right:g}}}}}, move: {{push: }}}}
"""

_FUNCTION = '''\
"""A flow of one's own: it moves each point independently of the others."""

import numpy as np


def swirl(points, time, dt):
    """Return points (N, 3) moved from `time`, seconds from the start of the shot, by `dt` seconds."""
    x, y, z = points.T
    turn = dt * 1.2 * np.sin(np.pi * time / 3.0) * np.exp(-(x**2) - z**2 + 0.5 * y)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([c * x + s * z, y, c * z - s * x], axis=1)
'''


def _write_function(path: Path) -> None:
    path.write_text(_FUNCTION, encoding="utf-8")


def _write_samples(path: Path) -> None:
    """Write velocities of two eddies on a grid, in place of those of a simulation."""
    import numpy as np

    axis = np.linspace(-1.5, 1.5, 13)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    velocity = np.stack([-np.sin(2 * y), np.sin(2 * x), 0.3 * np.cos(2 * x) + 0.0 * z], axis=-1)
    with path.open("wb") as file:
        np.savez_compressed(file, x=axis, y=axis, z=axis, velocity=velocity)


FLOW_FILES: Mapping[str, tuple[str, Callable[[Path], None]]] = {
    "sampled": (".npz", _write_samples),
    "python": (".py", _write_function),
}
"""The ending and the writer of the file that a flow reads."""


@dataclass(frozen=True)
class FlowPreset:
    """A subject that suits a flow, and values of its parameters; all texts are as in a shot file.

    values   by parameter; others take their defaults
    set      the place
    finest   edge length where the surface bends sharply, or None for one length everywhere
    within   a region that limits a flow which would move everything alike
    before   an entry of flows before it
    azimuth  of the camera, degrees, at the first and the last frame
    """

    subject: str = "{solid: icosphere, radius: 1}"
    values: Mapping[str, str] = field(default_factory=dict)
    max_edge_length: float = 0.08
    finest: float | None = None
    look: str = "clay"
    set: str = "window"
    within: str = ""
    before: str = ""
    azimuth: tuple[float, float] = (-30.0, 0.0)

    @property
    def edge_length(self) -> str:
        """The value of `max_edge_length` in the shot."""
        if self.finest is None:
            return f"{self.max_edge_length:g}"
        lengths = {"tolerance": 0.002, "finest": self.finest, "coarsest": self.max_edge_length}
        return _text({"curvature": lengths})


def _table(name: str) -> Any:
    """Return what a YAML file of this package holds."""

    def read() -> Any:
        from ruamel.yaml import YAML

        text = resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
        return YAML(typ="safe", pure=True).load(text)

    return kept(name, read)


def usual_strength(flow: str) -> tuple[str, list[float]] | None:
    """Return the parameter that sets the strength of a flow, and values for a ball of radius 1 at its centre.

    With the first the ball takes twice the vertices within 3 s, with the second ten times; there may be only
    the first. None where no parameter does that.
    """
    found = _table("flow_strengths.yaml").get(flow)
    return next(iter(found.items())) if found else None


@cache
def presets() -> Mapping[str, FlowPreset]:
    """Return the presets of `flow_presets.yaml` by flow."""
    table = _table("flow_presets.yaml")
    subjects = table.pop("subjects")
    return {flow: _preset(dict(row), subjects) for flow, row in table.items()}


def _preset(row: dict[str, Any], subjects: Mapping[str, Any]) -> FlowPreset:
    """Return the preset of a row of the table, with `pulse` and `ramp` as keys."""
    rest = row.pop("rest", 0)
    values = {name: _text(value) for name, value in row.pop("values", {}).items()}
    for name, value in row.pop("pulse", {}).items():
        values[name] = _pulse(value, [0] * len(value) if isinstance(value, list) else 0)
    values |= {name: _ramp(value, rest) for name, value in row.pop("ramp", {}).items()}
    subject = row.pop("subject", "ball")
    within, before = (_text(row.pop(name, "")) for name in ("within", "before"))
    subject = subjects[subject] if isinstance(subject, str) else subject
    return FlowPreset(_text(subject), values, within=within, before=before, **row)


def preset_of(flow: str) -> FlowPreset:
    """Return the preset of a flow, or one made from its parameters. Raises UsageError for an unknown flow."""
    fact = facts(flow)
    if flow in presets():
        return presets()[flow]
    values = {}
    for parameter in fact["parameters"]:
        name, default = parameter["name"], parameter["default"]
        if not parameter["keyed"] or not (parameter["required"] or name in STRENGTHS):
            continue
        if parameter["form"] == "vector":
            values[name] = _pulse([0.5, 0, 0], [0, 0, 0])
        elif fact["kind"] == "map":
            values[name] = _ramp(2, 1) if parameter["positive"] else _ramp(0.5, 0)
        else:
            rest = 0.01 if parameter["positive"] else 0
            values[name] = _pulse(0.5 if default is None else default, rest)
    return FlowPreset(values=values)


def _pulse(value: Any, rest: Any) -> str:
    """Return keys that go from rest to a value and back to rest."""
    quarter = FRAMES // 4
    return _text({"keys": {1: rest, quarter: value, FRAMES - quarter: value, FRAMES: rest}})


def _ramp(value: Any, rest: Any) -> str:
    """Return keys that go from rest to a value, and hold it for the last frames."""
    return _text({"ease": "sine_in_out", "keys": {1: rest, FRAMES - 8: value}})


def _text(value: Any) -> str:
    """Return a value as a shot file writes it in one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name}: {_text(item)}' for name, item in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(json.dumps(item) if isinstance(item, str) else _text(item) for item in value)}]"
    return value if isinstance(value, str) else f"{value:g}"


FIT = 2.0
"""Largest extent of models in new shots, scene units: that of most built-in solids, which flows suit."""

COARSEST = 0.08
"""Longest edge of new shots, scene units: a surface of this size bends smoothly."""

MOST_VERTICES = 35_000
"""Vertices at rest up to which a preview takes seconds."""

_DETAIL = 1.6
"""Longest edge over the usual edge of a model: its edges are then amid the limits, 40% and 100%."""


@dataclass(frozen=True)
class ModelTemplate:
    """Text for a new shot of a model.

    subject  the entry of the shot file
    facts    comments above it, a line each
    edges    a comment above the edge length
    notes    lines to tell: what was repaired in the file, and small parts that decide its size
    look     the look that replaces the flow's own, or None
    """

    subject: str
    facts: tuple[str, ...]
    edges: str
    max_edge_length: float
    notes: tuple[str, ...]
    look: str | None = None


def _is_painted(file: Path, is_copy: bool) -> bool:
    """Tell whether a shot can show a model's paint: a copy of the file alone lacks those that it names."""
    from flowsculpt.api.meshes import ModelFile

    try:
        materials, files, _ = ModelFile(file).materials()
    except FlowsculptError:
        return False
    has_textures = any(each.colour_texture or each.colour_from for each in materials)
    return (has_textures or len({each.colour for each in materials}) > 1) and not (files and is_copy)


def model_template(file: Path, reference: str, is_copy: bool = False) -> ModelTemplate:
    """Return the text for a new shot of a model file, which the shot names by `reference`.

    is_copy  True where the shot names a copy of the file alone

    Raises MissingInputError or MeshError for a file that is not a model.
    """
    from flowsculpt.api.meshes import ModelFile
    from flowsculpt.api.shots import Model
    from flowsculpt.pipeline.plugins.authoring.first_frame import small_parts

    imported = Model("", path=file).imported()
    mesh, up = imported.mesh, ModelFile(file).up()
    reader = ModelFile(file).reader
    assert reader is not None, "it has read the file"
    is_z_up = up == "z" and not reader.states_up
    size = mesh.bounds[1] - mesh.bounds[0]
    fitted = mesh.with_vertices(mesh.vertices * (FIT / size.max()))
    usual = usual_edge(fitted)
    length = suggested_edge_length(fitted)
    small = small_parts(mesh)
    parts = (f"{file.name} has {small}",) if small else ()
    extents = " × ".join(f"{side:.4g}" for side in size)
    word = reference if re.fullmatch(r"[\w./-]+", reference) else json.dumps(reference, ensure_ascii=False)
    units = "its own units" if imported.unit is None else f"its own units, of {imported.unit:.6g} m"
    facts = [f"{file.name}: {imported.vertices} vertices, {imported.faces} faces, {extents} in {units}."]
    if reader.read_part is not None:
        facts.append(f"Its stage has {up} up, which is heeded. prim: /World/Chair reads a part.")
    elif reader.states_up:
        facts.append(f"The file says that {up} points up, which is heeded. rotate: [0, 30, 0] turns it.")
    elif is_z_up:
        facts.append("Most STL files have z up. If the model lies on its back, write up: y.")
    else:
        facts.append(
            "If the model lies on its face, its file has z up: add up: z. rotate: [0, 30, 0] turns it."
        )
    is_painted = _is_painted(file, is_copy)
    if is_painted:
        facts.append("paint: on keeps its texture coordinates, colours and materials for look: model.")
    up_and_paint = ", up: z" * is_z_up + ", paint: on" * is_painted
    return ModelTemplate(
        look="model" if is_painted else None,
        subject=f"{{model: {word}, fit: {FIT:g}{up_and_paint}}}",
        facts=tuple(facts),
        edges=_about_edges(usual, length),
        max_edge_length=length,
        notes=(*imported.warnings, *parts),
    )


def usual_edge(mesh: PolygonMesh) -> float:
    """Return the median length of a mesh's edges, scene units."""
    import numpy as np

    ends = mesh.vertices[mesh.edges]
    return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))


def suggested_edge_length(mesh: PolygonMesh) -> float:
    """Return a maximum edge length that keeps a mesh's detail, unless that takes over MOST_VERTICES.

    A resampled surface of area A and maximum length L has up to 4.4 A / L² vertices.
    """
    area = float(mesh.areas.sum())
    length = min(max(_DETAIL * usual_edge(mesh), math.sqrt(4.4 * area / MOST_VERTICES)), COARSEST)
    return float(f"{length:.2g}")


def _about_edges(usual: float, length: float) -> str:
    own = f"The model's own edges are about {usual:.2g} long"
    if _DETAIL * usual < 0.9 * length:
        return f"{own}; {_DETAIL * usual:.2g} keeps all their detail, and takes longer."
    return f"{own}."


GENTLE = {"twist": {"amount": _ramp(45, 0)}}
"""Values by flow and parameter in shots of models, which are less simple than the solids of the presets."""


def shot_of_flow(flow: str, name: str, model: ModelTemplate | None = None) -> str:
    """Return the text of a shot called `name` with a flow, of a model or of a solid that suits the flow.

    Raises UsageError for an unknown flow.
    """
    preset = preset_of(flow)
    names = preset_names()
    solids = " · ".join(f"{solid} {', '.join(names[f'solid {solid}'])}" for solid in names["solids"])
    about_subject = f"# Solids: {solids}.\n# A mesh file beside this one: {{model: bunny.obj, fit: 2}}."
    if model is not None:
        about_subject = "\n".join(f"# {line}" for line in model.facts)
        values = {**preset.values, **GENTLE.get(flow, {})}
        edge = model.max_edge_length
        preset = replace(preset, subject=model.subject, max_edge_length=edge, finest=None, values=values)
        preset = replace(preset, look=model.look or preset.look)
    text = SHOT.format(
        title=title_of(name),
        last=FRAMES,
        about_subject=about_subject,
        about_edges="" if model is None else f"# {model.edges}\n",
        subject=preset.subject,
        edge=preset.edge_length,
        flows="\n".join(_entry(flow, preset)).replace("NAME", name),
        look=preset.look,
        coloured="clay" if preset.look == "model" else preset.look,
        looks=", ".join(preset_names()["look"]),
        left=preset.azimuth[0],
        right=preset.azimuth[1],
        set=choice(preset_names()["set"], preset.set),
    )
    return re.sub(
        r"^(.*\S)  # (.*)$", lambda line: f"{line[1]:<{COLUMN}}  # {line[2]}", text, flags=re.MULTILINE
    )


def shot_of_shot(text: str, name: str) -> str:
    """Return a copy of a shot's text under a title of its own, with its comments."""
    text = re.sub(r"^# yaml-language-server:.*\n", "", text)
    titled, count = re.subn(r"^title:.*$", f"title: {title_of(name)}", text, count=1, flags=re.MULTILINE)
    return titled if count else f"title: {title_of(name)}\n{text}"


def title_of(name: str) -> str:
    """Return a name as a title, quoted if YAML would read something else than text."""
    title = re.sub(r"[_-]+", " ", name)
    return f'"{title}"' if re.fullmatch(r"[\d.eE+ ]*|true|false|null|off|on|yes|no", title) else title


def choice(registry: Iterable[str], chosen: str = "") -> str:
    """Return the chosen name of a registry, or the first one, and the others as a comment."""
    names = list(registry)
    chosen = chosen or names[0]
    return f"{chosen}  # or {', '.join(name for name in names if name != chosen)}"


def _entry(flow: str, preset: FlowPreset) -> list[str]:
    """Return the entry under `flows`, a line for each parameter."""
    fact = facts(flow)
    lines = [f"  - {preset.before[1:-1]}"] if preset.before else []
    lines.append(f"  # {fact['description']}")
    indent = "  "
    if preset.within:
        lines += ["  - within:", f"      region: {preset.within}", "      flows:"]
        indent = "        "
    lines.append(f"{indent}- {flow}:")
    for parameter in fact["parameters"]:
        value = preset.values.get(parameter["name"])
        if value is None and not parameter["required"] and parameter["default"] not in (None, {}):
            value = default_text(parameter)
        if value is not None:
            lines.append(f"{indent}    {parameter['name']}: {value}  # {_comment(parameter)}")
    return lines


def _comment(parameter: dict[str, Any]) -> str:
    unit = f" ({parameter['unit']})" if parameter["unit"] else ""
    choices = f": {', '.join(parameter['choices'])}" if parameter["choices"] else ""
    return f"{parameter['description']}{choices}{unit}"


FIRST_SHOT = "A010_first"

SHARED = ("rate",)
"""Names that the defaults of a new show give, so that its shots need not."""

DEFAULTS = """\
# What all shots in this folder share. A shot that names something itself keeps its own.
rate: 24  # frames per second
# set: {set}; a place for all shots that name none
# lights: {lights}
# stage: {stage}
# look: clay
# picture: {{aspect: "9:16"}}  # upright; or {{size: [3840, 2160]}}, the pixels of final
# quality: {{draft: {{samples: 8}}, final: {{samples: 128}}}}  # samples a pixel, in place of 4 and 64
"""

FILM = """\
# The edit: flowsculpt film renders its shots and cuts them together.
title: {title}
credits: [Made with flowsculpt]
shots: [{shots}]
# rate: 24  # frames per second; by default that of its shots
# sound: {{file: music.wav}}
"""

MODELS = """\
Mesh files for shots: OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD. A shot in the folder above names one by
its path from there:

    subject: {model: models/bunny.obj}
"""

GIT_IGNORE = """\
/renders/
/.flowsculpt/
/.snakemake/
"""

EDITOR = {"yaml.schemas": {"shots/.schema/shot.json": "shots/*.yaml"}}
"""Settings of VS Code. Edits and defaults name their schemas in their first lines, which win."""


def show_files(name: str, shots: Sequence[str]) -> Mapping[str, str]:
    """Return the texts of a show's files but its shots, by path.

    name   of the show, from which its title is made
    shots  the names of the shots in its edit
    """
    return {
        "shots/defaults.yaml": SCHEMA.format(".schema/defaults.json")
        + DEFAULTS.format(**{kind: choice(preset_names()[kind]) for kind in ("lights", "stage", "set")}),
        "shots/film.yaml": SCHEMA.format(".schema/film.json")
        + FILM.format(title=title_of(name[:1].upper() + name[1:]), shots=", ".join(shots)),
        "shots/models/README.txt": MODELS,
        ".gitignore": GIT_IGNORE,
        ".vscode/settings.json": json.dumps(EDITOR, indent=2) + "\n",
        ".vscode/extensions.json": json.dumps({"recommendations": ["redhat.vscode-yaml"]}, indent=2) + "\n",
    }


def without_shared(text: str, shared: Iterable[str]) -> str:
    """Return the text of a new shot without the values, each in one line, that defaults give."""
    given = {*shared, "set"} if {"lights", "stage"} & set(shared) else set(shared)  # a set replaces both
    for name in {"rate", "set", "lights", "stage"} & given:
        text = re.sub(rf"^{name}: .*\n", "", text, count=1, flags=re.MULTILINE)
    return text
