"""Checks of look, camera, lights and qualities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pipeline.errors import suggestion
from pipeline.shot.documents.fields import is_number
from pipeline.shot.documents.lights_and_stage import ENVIRONMENTS
from pipeline.shot.yaml.plain_text import listed
from pipeline.shot.yaml.source import Problem, Where, YamlSource
from render.scene.lights import LIGHTS
from render.scene.materials import LOOKS
from render.scene.measure import Measure
from render.scene.quality import MIN_ADAPTIVE_SAMPLES, QUALITIES

ALTERNATIVES = {
    "focal_length": ("field_of_view",),
    "dolly": ("distance",),
    "position": ("azimuth", "elevation", "orbit", "distance", "dolly"),
}
"""Settings of a camera that exclude each other."""

_IS_OPEN = (
    "is for closed surfaces, and a sheet is open. Take a thin box, or a look that light does not go through."
)


def clear_look(source: YamlSource) -> Iterator[Problem]:
    """Check that light does not enter a sheet, which is open and has no inside."""
    subject, look = source.get("subject"), source.get("look")
    name = look.get("material") if isinstance(look, dict) else look
    if not (isinstance(subject, dict) and subject.get("solid") == "sheet"):
        return
    if isinstance(name, str) and name in LOOKS and LOOKS[name].is_clear:
        yield ("look",), f"look {name} {_IS_OPEN}"
    clear = _clear_bsdfs(source.get("look", "bsdf"), ("look", "bsdf"))
    yield from ((where, f"a {kind} {_IS_OPEN}") for where, kind in clear)


def _clear_bsdfs(bsdf: Any, where: Where) -> Iterator[tuple[Where, str]]:
    """Yield place and type of the materials within a material that light enters."""
    if isinstance(bsdf, dict):
        if bsdf.get("type") in ("dielectric", "roughdielectric"):
            yield (*where, "type"), bsdf["type"]
        for name, part in bsdf.items():
            yield from _clear_bsdfs(part, (*where, name))


def measurable(source: YamlSource) -> Iterator[Problem]:
    """Check that a cloud shows its speed: stretch and area are of triangles."""
    subject, look = source.get("subject"), source.get("look")
    if not (isinstance(subject, dict) and "cloud" in subject):
        return
    measure = source.get("look", "measure")
    name = look.get("material") if isinstance(look, dict) else look
    pattern = LOOKS[name].pattern if isinstance(name, str) and name in LOOKS else None
    default = pattern if isinstance(pattern, Measure) else None
    of = next(iter(measure), None) if isinstance(measure, dict) else default.of if default else None
    if of in ("stretch", "area"):
        yield (
            ("look", "measure") if measure else ("look",),
            f"look shows {of}, which triangles have, and a cloud has none. Take speed.",
        )


def camera(source: YamlSource) -> Iterator[Problem]:
    """Check that no two settings of a camera exclude each other, and that it is at most straight above."""
    written = source.get("camera")
    if not isinstance(written, dict):
        return
    elevation = written.get("elevation")
    if isinstance(elevation, int | float) and abs(elevation) > 90:
        yield (
            ("camera", "elevation"),
            f"camera.elevation is {elevation:g}; it must be from -90 to 90, which is straight above. "
            "Turn the camera by azimuth.",
        )
    given = [name for name, value in written.items() if value is not None]
    for one, alternatives in ALTERNATIVES.items():
        others = [name for name in alternatives if name in given]
        if one in given and others:
            verb, remove = ("sets", "one of them") if len(others) == 1 else ("set", one)
            lines = listed(f"`{name}:`" for name in others)
            yield (
                ("camera", one),
                f"{one} sets what {listed(others)} {verb} too. Remove {remove}, or write {lines} with "
                "nothing after it if inherited.",
            )


def dimmed(source: YamlSource) -> Iterator[Problem]:
    """Check that the lights whose intensity is set are there."""
    lights, intensities = source.get("lights"), source.get("lights", "intensity")
    if not (isinstance(lights, dict) and isinstance(intensities, dict)):
        return
    names = _light_names(lights)
    for name in intensities if names else ():
        if name not in names:
            yield ("lights", "intensity", name), f"{name} is no light here. {suggestion(str(name), names)}"


def _light_names(lights: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names that `intensity` can have; none for an unknown rig."""
    written = any(lights.get(name) is not None for name in ("softboxes", *ENVIRONMENTS))
    rig = lights.get("rig") or (None if written else "studio")
    if rig is None:
        return ("sun", "sky") if lights.get("sun") is not None else ("sky",)
    if rig not in LIGHTS:
        return ()
    names = LIGHTS[rig].names
    return (*names, "sun") if lights.get("sun") is not None and "sun" not in names else names


def noise_threshold(source: YamlSource) -> Iterator[Problem]:
    """Check that a quality with a noise threshold has enough samples to stop at fewer."""
    for name, quality in QUALITIES.items():
        place = ("quality", name, "noise_threshold")
        samples = source.get("quality", name, "samples")
        samples = quality.samples if samples is None else samples
        if is_number(source.get(*place)) and is_number(samples) and samples < MIN_ADAPTIVE_SAMPLES:
            written = source.written_path(place[:2])[-1]
            yield (
                place,
                f"{written} takes {samples} samples, too few to stop earlier; noise_threshold needs "
                f"{MIN_ADAPTIVE_SAMPLES} or more. Write samples: 256 beside it.",
            )
