"""Template of a new show: a folder with a first shot, defaults, an edit, and settings of editors."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence

from pipeline.shot.templates import SCHEMA, choice, title_of
from render.scene.lights import LIGHTS
from render.scene.stage import STAGES

FIRST_SHOT = "A010_first"

SHARED = ("rate", "lights", "stage")
"""Names that the defaults of a show give, so that its shots need not."""

DEFAULTS = """\
# What all shots in this folder share. A shot that names something itself keeps its own.
rate: 24  # frames per second
lights: {lights}
stage: {stage}
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
        + DEFAULTS.format(lights=choice(LIGHTS), stage=choice(STAGES)),
        "shots/film.yaml": SCHEMA.format(".schema/film.json")
        + FILM.format(title=title_of(name[:1].upper() + name[1:]), shots=", ".join(shots)),
        "shots/models/README.txt": MODELS,
        ".gitignore": GIT_IGNORE,
        ".vscode/settings.json": json.dumps(EDITOR, indent=2) + "\n",
        ".vscode/extensions.json": json.dumps({"recommendations": ["redhat.vscode-yaml"]}, indent=2) + "\n",
    }


def without_shared(text: str, shared: Sequence[str]) -> str:
    """Return the text of a new shot without the values, each in one line, that defaults give."""
    for name in set(SHARED) & set(shared):
        text = re.sub(rf"^{name}: .*\n", "", text, count=1, flags=re.MULTILINE)
    return text
