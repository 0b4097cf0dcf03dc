"""The text of a new shot: one that works at once, and says what may be changed."""

from __future__ import annotations

import re
from typing import Any

from pipeline.shot.documents.flow_catalogue import facts
from pipeline.shot.subject import SOLIDS
from pipeline.shot.templates.flow_presets import FRAMES, Staging, staging_of
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.stage import STAGES

SCHEMA = "# yaml-language-server: $schema={}\n"
"""What tells editors where the schema of a file is, relative to it."""

COLUMN = 58
"""At which comments after values begin, where these leave room."""

SHOT = """\
title: {title}
intent: What this shot should show, in one sentence.

frames: 1-{last}  # the first shows the subject at rest; the flow acts from the second on
rate: 24  # frames per second

# Solids: {solids}.
# A mesh file beside this one: {{model: bunny.obj, scale: 1}}.
subject: {subject}

# Edges longer than this are split, those shorter than 40% of it collapse. Half the length: 4 × the faces.
resample: {{max_edge_length: {edge:g}}}

# Entries act one after another in each frame, those under `sum:` at once. Keys are frames, "0.5s" is seconds.
flows:
{flows}

# Looks: {looks}.
look: {look}  # or {{material: {look}, colour: [0.6, 0.5, 0.4]}}
camera: {{azimuth: {{keys: {{1: {left:g}, {last}: {right:g}}}}}, elevation: 14}}  # degrees
lights: {lights}
stage: {stage}
"""


def shot_of_flow(flow: str, name: str) -> str:
    """A shot called `name` with a flow of the catalogue. Raises UsageError for one that is not known."""
    staging = staging_of(flow)
    solids = " · ".join(f"{solid} {', '.join(kind.measures)}" for solid, kind in SOLIDS.items())
    text = SHOT.format(
        title=_title(name),
        last=FRAMES,
        solids=solids,
        subject=staging.subject,
        edge=staging.max_edge_length,
        flows="\n".join(_entry(flow, staging)).replace("NAME", name),
        look=staging.look,
        looks=", ".join(LOOKS),
        left=staging.azimuth[0],
        right=staging.azimuth[1],
        lights=_choice(LIGHTS),
        stage=_choice(STAGES),
    )
    return re.sub(r"^(.*\S)  # (.*)$", _aligned, text, flags=re.MULTILINE)


def shot_of_shot(text: str, name: str) -> str:
    """A copy of a shot's text under a title of its own: its comments too, and free of the other."""
    text = re.sub(r"^# yaml-language-server:.*\n", "", text)
    titled, found = re.subn(r"^title:.*$", f"title: {_title(name)}", text, count=1, flags=re.MULTILINE)
    return titled if found else f"title: {_title(name)}\n{text}"


def _title(name: str) -> str:
    """As text, whatever it looks like."""
    title = re.sub(r"[_-]+", " ", name)
    return f'"{title}"' if re.fullmatch(r"[\d.eE+ ]*|true|false|null|off|on|yes|no", title) else title


def _choice(registry: Any) -> str:
    first, *others = registry
    return f"{first}  # or {', '.join(others)}"


def _aligned(line: re.Match[str]) -> str:
    return f"{line[1]:<{COLUMN}}  # {line[2]}"


def _entry(flow: str, staging: Staging) -> list[str]:
    """The entry under `flows`, a line for each parameter."""
    fact = facts(flow)
    lines = [f"  # {fact['sense']}"]
    inner = "  "
    if staging.within:
        lines += ["  - within:", f"      region: {staging.within}", "      flows:"]
        inner = "        "
    lines.append(f"{inner}- {flow}:")
    for parameter in fact["parameters"]:
        value = staging.values.get(parameter["name"]) or _default(parameter)
        if value is not None:
            lines.append(f"{inner}    {parameter['name']}: {value}  # {_told(parameter)}")
    return lines


def _default(parameter: dict[str, Any]) -> str | None:
    """The default of a parameter as a shot file has it; None where that is to say nothing."""
    value = parameter["default"]
    if value is None or value == {}:
        return None
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(f'{part:g}' for part in value)}]"
    return value if isinstance(value, str) else f"{value:.6g}"


def _told(parameter: dict[str, Any]) -> str:
    unit = f" ({parameter['unit']})" if parameter["unit"] else ""
    choices = f": {', '.join(parameter['choices'])}" if parameter["choices"] else ""
    return f"{parameter['sense']}{choices}{unit}"
