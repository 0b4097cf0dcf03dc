"""Mutations of what a shot shows: the form of its subject, its look, colours, light, stage and camera.

Hues of subject and stage turn together, so that their harmony stays; their lightness stays apart. Light rigs
keep their exposure.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flowsculpt.api.shots import PRESETS, is_number, linear_of_hex
from flowsculpt.pipeline.plugins.breed.colour_harmony import Lch, colour_words, lch, linear, stage_for
from flowsculpt.pipeline.plugins.breed.flow_mutations import Draft, Idea
from flowsculpt.pipeline.plugins.breed.gene_values import Chance, mapped, rounded, scaled

LOOK_WEIGHTS = {
    "clay": 3.0,
    "glaze": 3.0,
    "ceramic": 2.0,
    "taffy": 2.0,
    "pearl": 2.0,
    "cream": 2.0,
    "chrome": 1.0,
    "brushed": 1.0,
    "honey": 0.7,
    "glass": 0.5,
    "frosted": 0.5,
}
"""Looks that suit any form, and how often they are chosen."""

COLOURED = ("clay", "putty", "glaze", "ceramic", "taffy", "pearl", "cream", "coffee")
"""Looks of one colour that may be any."""

CLEAR = ("honey", "glass", "frosted", "smoke")
METALS = ("chrome", "brushed")

RIGS = ("studio", "gallery", "three_point", "softbox", "porcelain", "lacquer", "duotone", "monument")
"""Light rigs of opaque subjects; `macro` joins them where the subject fills the picture."""

MIRROR_RIGS = ("gallery", "studio", "lacquer", "duotone")
CLEAR_RIGS = ("gallery", "studio", "lacquer", "bright_field")

ON_GROUND = {"monument": (0.42, 0.36, 0.3), "bright_field": (0.3, 0.27, 0.24)}
"""Rigs whose horizon is seen, and the colours of their ground."""

CLOSE = 0.72
"""Factor on the camera's distance below which the subject fills the picture."""

PALE_STAGE, DARK_STAGE = Lch(0.64, 0.035, 80.0), Lch(0.4, 0.03, 260.0)
"""Stages for dark and for light or clear subjects, before their hues are chosen."""

SOLIDS: dict[str, dict[str, Any]] = {
    "cube": {"solid": "box", "size": [1.7, 1.7, 1.7]},
    "pillar": {"solid": "box", "size": [0.9, 2.2, 0.9]},
    "slab": {"solid": "box", "size": [2.1, 0.7, 1.5]},
    "ball": {"solid": "icosphere", "radius": 1},
    "rod": {"solid": "rod", "length": 2.5, "radius": 0.42, "caps": "round"},
    "drum": {"solid": "rod", "length": 1.1, "radius": 0.95, "caps": "flat"},
    "ring": {"solid": "torus", "radius": 0.85, "tube_radius": 0.33},
}
"""Solids of half-size 1 that may take each other's place."""


def proportions(draft: Draft) -> str:
    """Change the measures of the subject; equal sides stay equal."""
    subject = draft.data.get("subject")
    if not isinstance(subject, dict) or subject.get("solid") not in ("box", "rod", "torus", "sheet"):
        return ""
    chance, width = draft.chance, 0.2 + 0.8 * draft.chance.amount
    alike = chance.happens(0.4)
    for name in ("size", "radius", "length", "tube_radius"):
        if name in subject:
            subject[name] = mapped(subject[name], _grown(chance, name, alike, width))
    if subject["solid"] == "torus":
        tube, radius = subject.get("tube_radius", 0.4), subject.get("radius", 1)
        subject["tube_radius"] = rounded(min(max(tube, 0.12 * radius), 0.6 * radius))
    if subject["solid"] == "rod" and subject.get("caps", "round") == "round":  # half balls at both ends
        subject["radius"] = rounded(min(subject.get("radius", 0.5), 0.4 * subject.get("length", 3)))
    return "other proportions"


def _grown(chance: Chance, name: str, alike: bool, width: float) -> Callable[[float, int], float]:
    """Return a change of a measure, by a factor for each side, or for all sides of a length."""

    def change(value: float, side: int) -> float:
        return value * chance.shared((name, value if alike else side), lambda: chance.factor(width))

    return change


def other_solid(draft: Draft) -> str:
    """Exchange the solid for another one of the same size."""
    subject, half = draft.data.get("subject"), draft.parent.half
    if not isinstance(subject, dict) or subject.get("solid") not in ("box", "icosphere", "rod", "torus"):
        return ""
    if "size" in subject and min(subject["size"]) < 0.15 * max(subject["size"]):
        return ""  # a ribbon is what its shot is about
    names = [
        name
        for name, solid in SOLIDS.items()
        if solid["solid"] != subject["solid"] or name in ("pillar", "slab")
    ]
    name = draft.chance.random.choice(names)
    measures = {
        key: value if isinstance(value, str) else scaled(value, half) for key, value in SOLIDS[name].items()
    }
    draft.data["subject"] = measures
    return f"a {name} for the {_solid_name(subject)}"


def _solid_name(subject: dict[str, Any]) -> str:
    return {"box": "block", "icosphere": "ball", "torus": "ring"}.get(subject["solid"], str(subject["solid"]))


def other_look(draft: Draft) -> str:
    """Exchange the look; the stage is chosen to suit it."""
    old = look_name(draft.data.get("look", "clay"))
    if (
        old not in PRESETS["look"]
        or old in ("model", "symbolics_1990")
        or "subjects" in draft.data
        or _has_pattern(draft)
    ):
        return ""
    if "cloud" in (draft.data.get("subject") or {}):
        names = [name for name in ("clay", "glaze", "pearl", "taffy") if name != old]
    else:
        names = [name for name in LOOK_WEIGHTS if name != old]
    name = draft.chance.random.choices(names, [LOOK_WEIGHTS[name] for name in names])[0]
    draft.data["look"] = name
    draft.words[:] = [words for words in draft.words if not words.startswith("the look of ")]
    if name in ("glaze", "ceramic", "taffy", "clay") and draft.chance.happens(0.6):
        draft.data["look"] = {"material": name, "colour": linear(_any_colour(draft))}
    if name in (*CLEAR, *METALS):
        draft.data["lights"] = "gallery" if draft.chance.happens(0.8) else "studio"
    _suit_stage(draft)
    return f"in {_colour_of_look(draft.data['look'])}{name}"


def recoloured(draft: Draft) -> str:
    """Turn the hues of subject and stage together; or give a subject of one colour a colour of its own."""
    chance, data = draft.chance, draft.data
    turn = chance.random.choice((-1, 1)) * (25.0 + 240.0 * chance.amount * chance.random.uniform(0.2, 1.0))
    lighter, stronger = chance.spread(0.06 + 0.15 * chance.amount), chance.factor(0.2 + 0.5 * chance.amount)

    def changed(values: list[float]) -> list[float]:
        old = lch(values)
        return linear(
            Lch(
                min(0.92, max(0.3, old.lightness + lighter)), min(0.2, old.chroma * stronger), old.hue
            ).turned(turn)
        )

    look = data.get("look", "clay")
    name = look_name(look)
    if isinstance(look, dict) and isinstance(look.get("pigment"), dict):
        for pattern in look["pigment"].values():
            pattern["colours"] = [linear(lch(_linear(c)).turned(turn)) for c in pattern["colours"]]
            if "seed" in pattern:
                pattern["seed"] = chance.random.randrange(1, 1000)
    elif name in COLOURED and not (isinstance(look, dict) and {"measure", "bsdf"} & look.keys()):
        has_colour = isinstance(look, dict) and "colour" in look
        own = look["colour"] if has_colour else PRESETS["look"][name].colour
        if isinstance(own, str) and not own.startswith("#"):
            return ""
        old = list(_linear(own))
        if lch(old).chroma < 0.06 and chance.happens(0.6):
            old = linear(lch(old)._replace(chroma=chance.random.uniform(0.08, 0.15)))
        given = look if isinstance(look, dict) else {"material": look}
        data["look"] = {**given, "colour": changed(old)}
    elif name == "glass":
        tint = linear(Lch(0.86, 0.07, chance.random.uniform(0.0, 360.0)))
        data["look"] = {"material": "glass", "absorption": {"colour": tint, "depth": 0.6}}
    elif "subjects" not in data:
        turn = chance.random.uniform(0.0, 360.0)  # only the stage has a colour to change
    for subject in (data.get("subjects") or {}).values():
        own_look = subject.get("look")
        if isinstance(own_look, dict) and isinstance(own_look.get("colour"), list):
            subject["look"] = {**own_look, "colour": linear(lch(own_look["colour"]).turned(turn))}
    _suit_stage(draft, turn)
    stage = draft.data.get("stage")
    before = (
        f" before {colour_words(lch(_linear(stage['colour'])))}"
        if isinstance(stage, dict) and "colour" in stage
        else ""
    )
    return f"in {_colour_of_look(data.get('look')).strip() or 'other colours'}{before}"


def relit(draft: Draft) -> str:
    """Exchange the light rig."""
    lights = draft.data.get("lights", "studio")
    rig = lights if isinstance(lights, str) else lights.get("rig")
    if rig not in (*RIGS, *CLEAR_RIGS, "macro"):
        return ""
    look, camera = look_name(draft.data.get("look", "clay")), draft.data.get("camera") or {}
    names: tuple[str, ...] = MIRROR_RIGS if look in METALS else CLEAR_RIGS if look in CLEAR else RIGS
    if names is RIGS and is_number(dolly := camera.get("dolly", 1)) and dolly < CLOSE:
        names = (*RIGS, "macro")
    stage = draft.data.get("stage", "cyclorama")
    kind = stage if isinstance(stage, str) else stage.get("kind", "cyclorama")
    if kind == "none" or (isinstance(stage, dict) and stage.get("shadow_catcher")):
        names = tuple(name for name in names if name not in ON_GROUND)
    name = draft.chance.random.choice([name for name in names if name != rig])
    draft.data["lights"] = name
    if name in ON_GROUND:
        draft.data["stage"] = {"kind": "ground", "colour": list(ON_GROUND[name]), "horizon_fade": 3}
    elif rig in ON_GROUND and kind == "ground":
        draft.data["stage"] = "cyclorama"
        _suit_stage(draft)
    return f"under {name.replace('_', '-')} light"


def restaged(draft: Draft) -> str:
    """Exchange the stage for another kind, in the colour that it has."""
    stage = draft.data.get("stage", "cyclorama")
    kind = stage if isinstance(stage, str) else stage.get("kind", "cyclorama")
    if kind not in ("cyclorama", "plinth", "ground"):
        return ""
    new: dict[str, Any] = {
        "kind": draft.chance.random.choice([k for k in ("cyclorama", "plinth") if k != kind])
    }
    if isinstance(stage, dict) and "colour" in stage:
        new["colour"] = stage["colour"]
    if new["kind"] == "plinth":
        new["round"] = draft.chance.happens(0.6)
    draft.data["stage"] = new
    if kind == "ground":
        draft.data["lights"] = draft.chance.random.choice([name for name in RIGS if name not in ON_GROUND])
    return "on a plinth" if new["kind"] == "plinth" else "on a cyclorama"


def reviewed(draft: Draft) -> str:
    """Look from elsewhere; the automatic framing keeps the subject in the picture."""
    chance = draft.chance
    camera = draft.data.setdefault("camera", {})
    if not isinstance(camera, dict) or camera.keys() & {"position", "projection"}:
        return ""
    turn, rise = chance.spread(35.0 + 120.0 * chance.amount), chance.spread(5.0 + 30.0 * chance.amount)
    camera["azimuth"] = mapped(camera.get("azimuth", -30), lambda v, _: round(v + turn, 1))
    camera["elevation"] = mapped(
        camera.get("elevation", 14), lambda v, _: round(min(44.0, max(3.0, v + rise)), 1)
    )
    return "seen from above" if rise > 12 else "seen from another side"


def patterned(draft: Draft) -> str:
    """Change the pattern of a look: its scale, turbulence and seed."""
    look = draft.data.get("look")
    if not isinstance(look, dict) or not isinstance(look.get("pigment"), dict):
        return ""
    for pattern in look["pigment"].values():
        pattern["scale"] = rounded(pattern.get("scale", 1) * draft.chance.factor(0.3 + draft.chance.amount))
        pattern["seed"] = draft.chance.random.randrange(1, 1000)
        if is_number(pattern.get("turbulence")):
            pattern["turbulence"] = rounded(min(4.0, pattern["turbulence"] * draft.chance.factor(0.5)))
    return "another pattern"


def rescattered(draft: Draft) -> str:
    """Scatter copies, or the points of a cloud, in another way."""
    done = False
    for subject in (
        data for data in [draft.data.get("subject"), *(draft.data.get("subjects") or {}).values()] if data
    ):
        holder = subject if "cloud" in subject else subject.get("copies")
        if isinstance(holder, dict):
            holder["seed"], done = draft.chance.random.randrange(1, 10_000), True
    return "scattered differently" if done else ""


FORM: dict[Idea, float] = {proportions: 1.3, other_solid: 0.7, rescattered: 0.5, patterned: 0.7}
PICTURE: dict[Idea, float] = {other_look: 1.3, recoloured: 2.6, relit: 0.7, restaged: 0.4, reviewed: 0.8}
"""Mutations of the subject and of the picture, and how often each is tried against the others."""


def look_name(look: Any) -> str:
    """Return the name of the look that a value is, or is based on."""
    return str(look.get("material", "")) if isinstance(look, dict) else str(look)


def _colour_of_look(look: Any) -> str:
    """Return words for the colour that a look gives itself, with a space behind; or an empty text."""
    if isinstance(look, dict) and isinstance(look.get("colour"), list):
        return f"{colour_words(lch(look['colour']))} "
    return ""


def _any_colour(draft: Draft) -> Lch:
    """Return a colour of any hue that is neither dull nor shrill."""
    chance = draft.chance.random
    return Lch(chance.uniform(0.42, 0.8), chance.uniform(0.06, 0.15), chance.uniform(0.0, 360.0))


def _linear(colour: Any) -> list[float]:
    return linear_of_hex(colour) if isinstance(colour, str) else list(colour)


def _has_pattern(draft: Draft) -> bool:
    look = draft.data.get("look")
    return isinstance(look, dict) and bool(look.keys() & {"pigment", "measure", "bsdf", "projection"})


def _subject_colour(data: dict[str, Any]) -> Lch:
    """Return about the colour that the subject shows."""
    look = data.get("look", "clay")
    name = look_name(look)
    if isinstance(look, dict) and isinstance(look.get("pigment"), dict):
        colours = next(iter(look["pigment"].values()))["colours"]
        return lch(_linear(colours[0]))
    if isinstance(look, dict) and isinstance(look.get("colour"), list):
        return lch(look["colour"])
    if name in METALS or name in CLEAR:
        return Lch(0.85, 0.02, 80.0)  # shines before a dark stage
    return lch(list(PRESETS["look"][name].colour)) if name in PRESETS["look"] else Lch(0.6, 0.05, 80.0)


def _suit_stage(draft: Draft, turn: float = 0.0) -> None:
    """Choose a colour of the stage: its own turned, or one related to the subject's."""
    stage = draft.data.get("stage", "cyclorama")
    kind = stage if isinstance(stage, str) else stage.get("kind", "cyclorama")
    if kind == "none" or (isinstance(stage, dict) and stage.get("shadow_catcher")):
        return
    chance, subject = draft.chance, _subject_colour(draft.data)
    if isinstance(stage, dict) and isinstance(stage.get("colour"), list) and turn:
        ground = lch(stage["colour"]).turned(turn)
    else:
        base = PALE_STAGE if subject.lightness < 0.52 else DARK_STAGE
        relation = chance.random.choice((0.0, 25.0, -25.0, 150.0, 180.0, 210.0))
        ground = base._replace(
            hue=(subject.hue + relation) % 360.0,
            lightness=base.lightness + chance.spread(0.06),
            chroma=chance.random.uniform(0.015, 0.06),
        )
    kept = stage if isinstance(stage, dict) else {"kind": kind}
    draft.data["stage"] = {**kept, "colour": linear(stage_for(ground, subject))}
