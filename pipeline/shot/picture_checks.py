"""Checks of look, camera, lights and qualities."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from flowsculpt.pipeline.errors import UsageError, quote, suggest
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.mesh.mesh_formats import suffix_of
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.shot.documents.field_types import is_number
from flowsculpt.pipeline.shot.documents.light_documents import ENVIRONMENTS, softbox_name
from flowsculpt.pipeline.shot.documents.look_documents import ALL_LOOKS, check_bsdf
from flowsculpt.pipeline.shot.documents.subject_documents import points_kind
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource, dotted_path, listed
from flowsculpt.render.scene.materials import Material, Painted
from flowsculpt.render.scene.measured_colours import Measure
from flowsculpt.render.scene.render_camera import KINDS
from flowsculpt.render.scene.render_quality import MIN_ADAPTIVE_SAMPLES, QUALITIES
from flowsculpt.render.scene.scene_lights import BACKGROUND, LIGHTS
from flowsculpt.render.scene.scene_sets import SETS
from flowsculpt.render.scene.texture_projection import MODEL

ALTERNATIVES = {
    "focal_length": ("field_of_view",),
    "dolly": ("distance",),
    "position": ("azimuth", "elevation", "orbit", "distance", "dolly"),
}
"""Settings of a camera that exclude each other."""

_IS_OPEN = (
    "is for closed surfaces, and a sheet is open. Take a thin box, or a look that light does not go through."
)


def check_named_settings(source: YamlSource) -> Iterator[Problem]:
    """Check that looks and rigs with names of the show's own are there; documents know only the others."""
    for names, entry, base_name, known in (
        ("looks", "look", "material", ALL_LOOKS),
        ("rigs", "lights", "rig", LIGHTS),
    ):
        named, value = source.mapping(names), source.get(entry)
        name = value.get(base_name) if isinstance(value, dict) else value
        if not named or not isinstance(name, str) or name in known:
            continue
        where: Where = (entry, base_name) if isinstance(value, dict) else (entry,)
        if (hint := suggest(name, map(str, named), listing="")).startswith("Did"):
            yield where, f"{dotted_path(where)}: {quote(name)} is not among `{names}`. {hint}"


def check_set(source: YamlSource) -> Iterator[Problem]:
    """Check that the set that a shot names is there."""
    name, own = source.get("set"), source.mapping("sets")
    if name is not None and name not in SETS and name not in own:
        yield ("set",), f"set {quote(name)} is not a set. {suggest(str(name), [*SETS, *map(str, own)])}"


def check_clear_look(source: YamlSource) -> Iterator[Problem]:
    """Check that light does not enter a sheet, which is open and has no inside."""
    if source.mapping("subject").get("solid") != "sheet":
        return
    name, look = _look_at(source, "look")
    if look and look.is_clear:
        yield ("look",), f"look {name} {_IS_OPEN}"
    for where, kind in _clear_bsdfs(source.get("look", "bsdf"), ("look", "bsdf")):
        yield where, f"a {kind} {_IS_OPEN}"


def _look_at(source: YamlSource, *where: Any) -> tuple[Any, Material | None]:
    """Return the name of the look at a path, and the look if there is one of that name."""
    look = source.get(*where)
    name = look.get("material") if isinstance(look, dict) else look
    return name, ALL_LOOKS.get(name) if isinstance(name, str) else None


def _clear_bsdfs(bsdf: Any, where: Where) -> Iterator[tuple[Where, str]]:
    """Yield place and type of the materials within a material that light enters."""
    if isinstance(bsdf, dict):
        if bsdf.get("type") in ("dielectric", "roughdielectric"):
            yield (*where, "type"), bsdf["type"]
        for name, part in bsdf.items():
            yield from _clear_bsdfs(part, (*where, name))


def check_paint(source: YamlSource) -> Iterator[Problem]:
    """Check that a look has the paint of a model that it shows, and that the model's format is read."""
    subject, (_, look) = source.mapping("subject"), _look_at(source, "look")
    is_painted = subject.get("paint") == "on"
    if (
        is_painted
        and isinstance(model := subject.get("model"), str)
        and suffix_of(model) not in (painted := plugins().readers("paint"))
    ):
        known = listed(painted, "or") if painted else "files by plug-ins alone, and none does"
        yield ("subject", "paint"), f"paint is read from {known}; this is {quote(model)}. Leave it out."
    if isinstance(look, Painted) and not is_painted:
        paint = "Write subject: {model: FILE.obj, paint: on}."
        yield ("look",), f"look model shows the paint of a model. {paint}"
    elif source.get("look", "projection", "kind") == MODEL and not (is_painted or "solid" in subject):
        paint = "Write paint: on there" if "model" in subject else "Take a solid, or a model with paint: on"
        yield ("look", "projection"), f"projection model needs texture coordinates of the subject. {paint}."


def check_measured_look(source: YamlSource) -> Iterator[Problem]:
    """Check that a cloud shows its speed: stretch and area are of triangles."""
    kind = points_kind(source.mapping("subject"))
    if kind is None or kind.is_net:
        return
    measure, (_, look) = source.get("look", "measure"), _look_at(source, "look")
    default = look.pattern.of if look and isinstance(look.pattern, Measure) else None
    of = next(iter(measure), None) if isinstance(measure, dict) else default
    if of in ("stretch", "area"):
        yield (
            ("look", "measure") if measure else ("look",),
            f"look shows {of}, which triangles have, and a cloud has none. Take speed.",
        )


def check_drawn_alone(source: YamlSource) -> Iterator[Problem]:
    """Check that no look which is drawn without lights stands among several subjects."""
    entries = source.mapping("subjects")
    for where in (("look",), *(("subjects", name, "look") for name in entries)) if entries else ():
        name, look = _look_at(source, *where)
        if look and not look.is_lit:
            yield where, f"look {name} is drawn without lights and shows one subject. Take another look."


def check_camera(source: YamlSource) -> Iterator[Problem]:
    """Check that no two settings of a camera exclude each other, and that it is at most straight above."""
    written = source.mapping("camera")
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


def check_wide_camera(source: YamlSource) -> Iterator[Problem]:
    """Check that a camera has only what its projection has, and that look and AOVs suit a wide one."""
    written = source.mapping("camera")
    kind = written.get("projection")
    kind = "perspective" if kind is None else kind
    if kind not in KINDS:
        return
    for name, owner in (("dome_angle", "dome"), ("dome_elevation", "dome"), ("eye_distance", "vr180")):
        if written.get(name) is not None and kind != owner:
            yield (
                ("camera", name),
                f"{name} is of projection {owner}, and this camera has {kind}. Write projection: {owner}, or "
                f"remove {name}.",
            )
    if kind == "perspective":
        return
    for name in ("focal_length", "sensor_width", "aperture", "focus"):
        if written.get(name) is not None:
            yield (
                ("camera", name),
                f"{name} is of a perspective lens; projection {kind} has none and is sharp everywhere. "
                f"Remove {name}, or write `{name}:` with nothing after it if inherited.",
            )
    if source.get("picture") is not None:
        yield (
            ("picture",),
            f"projection {kind} has sizes of its own, and picture is the shape of flat pictures. Remove "
            "picture, or write `picture:` with nothing after it if inherited.",
        )
    yield from _not_wide(source, kind)


def _not_wide(source: YamlSource, kind: str) -> Iterator[Problem]:
    """Yield what is made for flat pictures: drawn looks, and motion of one eye."""
    of_overrides = [("overrides", index, "look") for index in range(len(source.listing("overrides")))]
    of_subjects = [("subjects", name, "look") for name in source.mapping("subjects")]
    for where in (("look",), *of_overrides, *of_subjects):
        name, look = _look_at(source, *where)
        if look and not look.is_lit:
            yield (
                where,
                f"look {name} is drawn before a flat background, which projection {kind} has not. Take "
                "another look.",
            )
    if kind == "vr180" and "motion" in (*source.mapping("aovs"), *source.listing("aovs")):
        yield (
            ("aovs",),
            "AOV motion is that of one eye, and projection vr180 has two. Write layers: nuke, whose motion "
            "is that of each pixel's eye.",
        )


def check_dimmed_lights(source: YamlSource) -> Iterator[Problem]:
    """Check that the lights whose intensity is set are there."""
    names = _light_names(source.get("lights"))
    for name in source.mapping("lights", "intensity"):
        if names and name not in names:
            yield ("lights", "intensity", name), f"{name} is not a light here. {suggest(name, names, 0.7)}"


def check_light_groups(source: YamlSource) -> Iterator[Problem]:
    """Check that the lights of light groups are there, each in one group, and that names differ."""
    groups, written = source.get("light_groups"), source.get("lights")
    names = _light_names(written)
    name, look = _look_at(source, "look")
    if groups not in (None, "off") and look and not look.is_lit:
        yield (
            ("light_groups",),
            f"look {name} is drawn without lights, so it has no light groups. Remove light_groups, or use "
            "another look.",
        )
    if not (isinstance(groups, dict) and names):
        return
    if names and _shows_sky(written):
        names = (*names, BACKGROUND)
    group_of: dict[str, Any] = {}
    for group, members in groups.items():
        lights = list(enumerate(members)) if isinstance(members, list) else [(None, members)]
        for index, light in lights:
            where = ("light_groups", group) if index is None else ("light_groups", group, index)
            if not isinstance(light, str):
                continue  # the document reports it
            if light == BACKGROUND and light not in names:
                yield (
                    where,
                    "background is what the camera sees of the sky, and it sees none here. Remove it, or "
                    "write visible: true for the sky.",
                )
            elif light not in names:
                yield where, f"{light} is not a light here. {suggest(light, names, 0.7)}"
            elif light in group_of:
                yield where, f"{light} is in group {group_of[light]} already. Remove one of the two."
            group_of.setdefault(light, group)
    for group in groups:
        if group in names and group not in group_of:
            yield (
                ("light_groups", group),
                f"{group} is a light of no group, whose own group has this name. Take another name here.",
            )


def _light_names(lights: Any) -> tuple[str, ...]:
    """Return the names of the lights of a shot; none for an unknown rig."""
    if lights is None or isinstance(lights, str):
        lights = {"rig": lights}
    if not isinstance(lights, dict):
        return ()
    softboxes = lights.get("softboxes")
    names = [
        softbox_name(str(box["name"]) if isinstance(box, dict) and box.get("name") else None, number)
        for number, box in enumerate(softboxes if isinstance(softboxes, list) else (), 1)
    ]
    is_written = any(lights.get(name) is not None for name in ("softboxes", *ENVIRONMENTS))
    rig = lights.get("rig") or (None if is_written else "studio")
    if rig not in (None, *LIGHTS):
        return ()
    others = LIGHTS[rig].names if rig else ("sky",)
    distant = ("sun",) if lights.get("sun") is not None else ()
    return tuple(dict.fromkeys([*others[:-1], *names, *distant, "sky"]))


def _shows_sky(lights: Any) -> bool:
    """Tell whether the camera sees the sky, the daylight or the environment map of a shot."""
    if not isinstance(lights, dict):
        return isinstance(lights, str) and lights in LIGHTS and LIGHTS[lights].shows_sky
    for name, default in (("sun", True), ("sky", False)):
        if isinstance(written := lights.get(name), dict):
            return written.get("visible", default) is True
    if lights.get("hdri") is not None:
        return lights.get("visible", True) is True
    return _shows_sky(lights.get("rig"))


def check_noise_threshold(source: YamlSource) -> Iterator[Problem]:
    """Check that a quality with a noise threshold has enough samples to stop at fewer."""
    for name, quality in QUALITIES.items():
        place = ("quality", name, "noise_threshold")
        samples = source.get("quality", name, "samples")
        samples = quality.samples if samples is None else samples
        if is_number(source.get(*place)) and is_number(samples) and samples < MIN_ADAPTIVE_SAMPLES:
            yield (
                place,
                f"{name} takes {samples} samples, too few to stop earlier; noise_threshold needs "
                f"{MIN_ADAPTIVE_SAMPLES} or more. Write samples: 128 beside it.",
            )


@dataclass(frozen=True)
class _OverriddenSource(YamlSource):
    """A shot file as it is for the frames of one override, whose number is `index`."""

    index: int = 0

    def has(self, *where: Any) -> bool:
        """Tell whether the override has this value, or look or lights of which it is a part."""
        whole = where[:1] if where[0] in ("look", "lights") else where
        return super().get("overrides", self.index, *whole) is not None

    def get(self, *where: Any) -> Any:
        return super().get(*(("overrides", self.index) if self.has(*where) else ()), *where)


def check_overrides(source: YamlSource) -> Iterator[Problem]:
    """Check the frames of overrides, and their looks, lights and qualities as those of the shot."""
    taken: dict[int, int] = {}
    for index, override in enumerate(source.listing("overrides")):
        if not isinstance(override, dict):
            continue
        yield from _overridden_frames(source, index, taken)
        yield from _whole_shot_only(source, index)
        seen = _OverriddenSource(source.path, source.data, source.places, index=index)
        for check in (check_clear_look, check_paint, check_bsdf, check_dimmed_lights, check_noise_threshold):
            for where, text in check(seen):
                if seen.has(*where):
                    yield ("overrides", index, *where), text


def _overridden_frames(source: YamlSource, index: int, taken: dict[int, int]) -> Iterator[Problem]:
    """Check that frames are in the shot, and in no override before; note them in `taken`."""
    where, text = ("overrides", index, "frames"), source.get("overrides", index, "frames")
    if not isinstance(text, str | int) or isinstance(text, bool):
        return  # the document reports it
    try:
        frames = FrameRange.parse(str(text))
        whole = FrameRange.parse(str(source.get("frames")))
    except UsageError as error:
        yield where, str(error)
        return
    if outside := frames.outside(whole).numbers:
        yield (
            where,
            f"frames {FrameRange.of(outside)} are not in the shot, which has {whole}. Write frames of it.",
        )
    if both := [number for number in frames if number in taken]:
        yield (
            where,
            f"frames {FrameRange.of(both)} are in overrides.{taken[both[0]]} too; a frame has one override. "
            "Take them out of one.",
        )
    taken.update(dict.fromkeys(frames, index))


def _whole_shot_only(source: YamlSource, index: int) -> Iterator[Problem]:
    """Check that an override has nothing that all frames of a shot share."""
    where: Where = ("overrides", index)
    if source.get(*where, "lights", "exposure") is not None:
        yield (
            (*where, "lights", "exposure"),
            "exposure belongs to the display of the whole shot. Change the intensity of the lights.",
        )
    for quality in QUALITIES:
        for setting in ("denoise", "temporal_denoise"):
            if source.get(*where, "quality", quality, setting) is not None:
                yield (
                    (*where, "quality", quality, setting),
                    f"{setting} belongs to the whole shot: denoising reads frames beside. Write it there.",
                )
    if source.get(*where, "lights") is not None and source.get("light_groups") not in (None, "off"):
        yield (
            (*where, "lights"),
            "light_groups are layers that all frames have, of the same lights. Remove lights here, or "
            "light_groups.",
        )
    name, look = _look_at(source, *where, "look")
    if look and (not look.is_lit or isinstance(look.pattern, Measure)):
        what = "shows measures of the motion" if look.is_lit else "is drawn without lights"
        yield (*where, "look"), f"look {name} {what}, which all frames of a shot share. Take another look."
